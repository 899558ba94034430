//! Whole-pixel rectangles: where a picture's samples lie in the plane.

use serde::{Deserialize, Serialize};

/// A rectangle of whole pixels: columns `x .. x + width`, rows `y .. y + height`, so that it covers the plane from (x, y) to (x + width, y + height).
///
/// As text it is `[left, top, right, bottom]`, the ends exclusive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(from = "[i64; 4]", into = "[i64; 4]")]
pub struct Window {
    /// First column.
    pub x: i64,
    /// First row; rows go down.
    pub y: i64,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl From<[i64; 4]> for Window {
    fn from([left, top, right, bottom]: [i64; 4]) -> Self {
        Self::from_bounds(left, top, right, bottom)
    }
}

impl From<Window> for [i64; 4] {
    fn from(window: Window) -> Self {
        [window.x, window.y, window.right(), window.bottom()]
    }
}

impl Window {
    /// The rectangle with its first pixel at (`x`, `y`).
    pub fn new(x: i64, y: i64, width: usize, height: usize) -> Self {
        Self { x, y, width, height }
    }

    /// The rectangle of `width` by `height` pixels at the origin.
    pub fn at_origin(width: usize, height: usize) -> Self {
        Self::new(0, 0, width, height)
    }

    /// The rectangle from `left`, `top` up to but without `right`, `bottom`; empty where these are crossed.
    pub fn from_bounds(left: i64, top: i64, right: i64, bottom: i64) -> Self {
        let width = usize::try_from(right.saturating_sub(left)).unwrap_or(0);
        let height = usize::try_from(bottom.saturating_sub(top)).unwrap_or(0);
        Self::new(left, top, width, height)
    }

    /// The column after the last.
    pub fn right(&self) -> i64 {
        self.x.saturating_add_unsigned(self.width as u64)
    }

    /// The row after the last.
    pub fn bottom(&self) -> i64 {
        self.y.saturating_add_unsigned(self.height as u64)
    }

    /// Whether it has no pixel.
    pub fn is_empty(&self) -> bool {
        self.width == 0 || self.height == 0
    }

    /// Number of samples of a picture of `channels` in this window; `None` where it overflows.
    pub fn samples(&self, channels: usize) -> Option<usize> {
        self.width.checked_mul(self.height)?.checked_mul(channels)
    }

    /// The common part; empty where there is none.
    pub fn intersect(&self, other: &Self) -> Self {
        let (left, top) = (self.x.max(other.x), self.y.max(other.y));
        Self::from_bounds(left, top, self.right().min(other.right()), self.bottom().min(other.bottom()))
    }

    /// The smallest window over both; an empty one adds nothing.
    pub fn union(&self, other: &Self) -> Self {
        if self.is_empty() {
            return *other;
        }
        if other.is_empty() {
            return *self;
        }
        let (left, top) = (self.x.min(other.x), self.y.min(other.y));
        Self::from_bounds(left, top, self.right().max(other.right()), self.bottom().max(other.bottom()))
    }

    /// Grown by `x` columns at the left and at the right and by `y` rows at the top and at the bottom.
    pub fn grow(&self, x: usize, y: usize) -> Self {
        let (dx, dy) = (x as i64, y as i64);
        Self::new(self.x.saturating_sub(dx), self.y.saturating_sub(dy), self.width.saturating_add(2 * x), self.height.saturating_add(2 * y))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intersection_and_union() {
        let (a, b) = (Window::new(-2, 0, 5, 4), Window::new(1, 3, 5, 5));
        assert_eq!(a.intersect(&b), Window::new(1, 3, 2, 1));
        assert_eq!(a.union(&b), Window::new(-2, 0, 8, 8));
        assert!(a.intersect(&Window::new(3, 0, 9, 9)).is_empty());
        assert_eq!(a.union(&Window::new(90, 90, 0, 3)), a);
        assert_eq!(Window::default().union(&a), a);
    }
}
