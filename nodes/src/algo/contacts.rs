//! When a foot stands: it is slow, and low.
//!
//! **Source** usual practice in motion capture; compared in Ikemoto, Arikan, Forsyth, *Knowing when to put your foot down*, 2006.

use nalgebra::Vector3;

/// What makes a contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// Faster is none, metres a second.
    pub speed: f64,
    /// Higher above the lowest place of the motion is none, metres.
    pub height: f64,
    /// Shorter is none, positions.
    pub least: usize,
}

/// First and last position of each stand on a path of so many positions a second. A position stands where the way to either neighbour is slow, so
/// that a stand begins with the touch and ends with the lift. Paths with a coordinate that is not finite have no stand there. O(positions).
pub fn contacts(path: &[Vector3<f64>], rate: f64, contact: Contact) -> Vec<(usize, usize)> {
    let lowest = path.iter().map(|p| p.y).filter(|y| y.is_finite()).fold(f64::INFINITY, f64::min);
    let slow = |a: usize, b: usize| path.get(a).zip(path.get(b)).is_some_and(|(a, b)| (b - a).norm() * rate <= contact.speed);
    let stands = |k: usize| path[k].y - lowest <= contact.height && (slow(k, k + 1) || k > 0 && slow(k - 1, k));
    let mut found: Vec<(usize, usize)> = Vec::new();
    for k in (0..path.len()).filter(|&k| stands(k)) {
        match found.last_mut() {
            // The way from the one before is slow too, or a quick step has come between.
            Some((_, last)) if *last + 1 == k && slow(k - 1, k) => *last = k,
            _ => found.push((k, k)),
        }
    }
    found.retain(|(first, last)| last - first + 1 >= contact.least.max(1));
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    const FOOT: Contact = Contact { speed: 0.2, height: 0.03, least: 2 };

    /// Stands, steps, stands, slides, hangs in the air.
    fn steps() -> Vec<Vector3<f64>> {
        let at = |x: f64, y: f64| Vector3::new(x, y, 0.0);
        let mut path = vec![at(0.0, 0.08); 5];
        path.extend([at(0.1, 0.15), at(0.3, 0.2), at(0.5, 0.12)]);
        path.extend(vec![at(0.6, 0.081); 4]);
        path.extend([at(0.7, 0.08), at(0.8, 0.08)]);
        path.extend(vec![at(0.9, 0.3); 4]);
        path
    }

    #[test]
    fn a_foot_stands_where_it_is_slow_and_low() {
        assert_eq!(contacts(&steps(), 12.0, FOOT), [(0, 4), (8, 11)]);
        assert_eq!(contacts(&steps(), 12.0, Contact { height: 1.0, ..FOOT }), [(0, 4), (8, 11), (14, 17)]);
        assert_eq!(contacts(&steps(), 12.0, Contact { least: 5, ..FOOT }), [(0, 4)]);
        assert_eq!(contacts(&steps(), 12.0, Contact { speed: 1e9, height: 1.0, least: 1 }), [(0, 17)]);
    }

    #[test]
    fn what_is_not_known_does_not_stand() {
        let mut path = steps();
        path[2] = Vector3::repeat(f64::NAN);
        assert_eq!(contacts(&path, 12.0, FOOT), [(0, 1), (3, 4), (8, 11)]);
        assert_eq!(contacts(&[], 12.0, FOOT), []);
        assert_eq!(contacts(&[Vector3::zeros()], 12.0, Contact { least: 1, ..FOOT }), [], "one position has no speed");
    }
}
