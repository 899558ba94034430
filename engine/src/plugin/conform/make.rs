//! Values of every type to stand at a node's inputs: ordinary ones, and such as nobody should have made.

use crate::array::{Array, DType, Data};
use crate::value::{OwnedParts, ValueRef, ValueType};

/// What values are like.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Small, finite, as everywhere.
    Ordinary,
    /// Others of the same sizes.
    Other,
    /// No rows, no points.
    Empty,
    /// One row, one column, one point.
    One,
    /// Pictures of no channels.
    NoChannels,
    /// No number is one.
    Nan,
    /// Infinities of both signs.
    Infinite,
    /// As large as f32 goes.
    Huge,
    /// All the same: nothing to hold on to.
    Constant,
    /// Pictures that fill a part of what is shown, and reach beyond it.
    Shifted,
    /// Pictures in a frame larger than any memory.
    Vast,
}

/// Extents of the axes that a type's schema calls by letters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sizes {
    /// Rows of a picture, `h`.
    pub height: usize,
    /// Columns of a picture, `w`.
    pub width: usize,
    /// Channels of a picture, `c`.
    pub channels: usize,
    /// Frames, `t`.
    pub frames: usize,
    /// All else: points, joints, triangles.
    pub points: usize,
}

impl Sizes {
    /// Of ordinary values.
    pub const ORDINARY: Self = Self { height: 9, width: 12, channels: 4, frames: 4, points: 6 };

    fn extent(self, axis: &str) -> usize {
        match (axis.parse(), axis) {
            (Ok(number), _) => number,
            (_, "h") => self.height,
            (_, "w") => self.width,
            (_, "c") => self.channels,
            (_, "t") => self.frames,
            _ => self.points,
        }
    }
}

impl Kind {
    /// All that nobody should have made.
    pub const WRONG: [Self; 9] =
        [Self::Empty, Self::One, Self::NoChannels, Self::Nan, Self::Infinite, Self::Huge, Self::Constant, Self::Shifted, Self::Vast];

    /// The extents that values of this kind have if nothing else is said.
    pub fn sizes(self) -> Sizes {
        let ordinary = Sizes::ORDINARY;
        match self {
            Self::Empty => Sizes { height: 0, width: 0, points: 0, ..ordinary },
            Self::One => Sizes { height: 1, width: 1, points: 1, ..ordinary },
            Self::NoChannels => Sizes { channels: 0, ..ordinary },
            _ => ordinary,
        }
    }

    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Ordinary => "ordinary values",
            Self::Other => "other values",
            Self::Empty => "values of no rows and no points",
            Self::One => "values of one row, column and point",
            Self::NoChannels => "pictures of no channels",
            Self::Nan => "NaN everywhere",
            Self::Infinite => "infinities",
            Self::Huge => "numbers of 3e38 and -3e38",
            Self::Constant => "values all the same",
            Self::Shifted => "pictures whose data window lies beyond the display window",
            Self::Vast => "pictures of 2000000x2000000 shown",
        }
    }

    fn sample(self, i: usize) -> f64 {
        // Neither sorted nor random: neighbours differ, and every run has the same.
        let mixed = |by: usize| ((i * by + 3) % 17) as f64 / 17.0;
        match self {
            Self::Nan => f64::NAN,
            Self::Infinite if i.is_multiple_of(2) => f64::INFINITY,
            Self::Infinite => f64::NEG_INFINITY,
            Self::Huge if i.is_multiple_of(2) => 3e38,
            Self::Huge => -3e38,
            Self::Constant => 0.5,
            Self::Other => mixed(11),
            _ => mixed(7),
        }
    }

    fn array(self, sizes: Sizes, dtype: DType, shape: &str, offset: usize) -> Array {
        let axes = shape.trim_matches(['[', ']']).split(',').map(str::trim).filter(|a| !a.is_empty());
        let shape: Vec<usize> = axes.map(|a| sizes.extent(a)).collect();
        let n: usize = shape.iter().product();
        let whole = |i: usize| (i + offset + usize::from(self == Self::Other)) % 3;
        let data = match dtype {
            DType::F32 => Data::F32((0..n).map(|i| self.sample(i + offset) as f32).collect()),
            DType::F64 => Data::F64((0..n).map(|i| self.sample(i + offset)).collect()),
            DType::I64 => Data::I64((0..n).map(|i| whole(i) as i64).collect()),
            DType::U32 => Data::U32((0..n).map(|i| whole(i) as u32).collect()),
            DType::U8 => Data::U8((0..n).map(|i| whole(i) as u8).collect()),
        };
        Array { shape, data }
    }

    /// A value of this kind; other numbers with another `offset`. `None` where the type does not take it.
    pub fn value(self, ty: &ValueType, sizes: Sizes, offset: usize) -> Option<ValueRef> {
        let arrays = ty.schema.arrays.iter().map(|a| (a.name.into(), self.array(sizes, a.dtype, a.shape, offset)));
        let mut parts = OwnedParts { arrays: arrays.collect(), ..OwnedParts::default() };
        self.hold_together(&mut parts, ty.schema.name);
        let windows = match self {
            Self::Shifted => Some(([-3, 4, 9, 13], [0, 0, 12, 9])),
            Self::Vast => Some(([0, 0, 12, 9], [-1_000_000, -1_000_000, 1_000_000, 1_000_000])),
            _ => None,
        };
        if let Some((data, display)) = windows.filter(|_| ty.schema.texts.iter().any(|t| t.name == "data_window")) {
            parts.meta.insert("data_window".to_owned(), data.as_slice().into());
            parts.meta.insert("display_window".to_owned(), display.as_slice().into());
        }
        (ty.from_parts)(parts).ok()
    }

    /// Makes the arrays of the common types ones that go together, as any numbers do not.
    fn hold_together(self, parts: &mut OwnedParts, type_name: &str) {
        // Any numbers make no tree; a chain is one.
        if let Some((_, Array { data: Data::I64(parents), .. })) = parts.arrays.iter_mut().find(|(name, _)| name == "parents") {
            parents.iter_mut().zip(-1..).for_each(|(p, before)| *p = before);
        }
        // Any numbers make no camera; these see what lies before the origin.
        if type_name == "Camera" && matches!(self, Self::Ordinary | Self::Other) {
            for (_, array) in &mut parts.arrays {
                match &mut array.data {
                    Data::F64(m) if m.len() == 16 => m[12..].copy_from_slice(&[0.0, 0.0, 0.0, 1.0]),
                    Data::I64(size) => *size = vec![12, 9],
                    _ => {}
                }
            }
        }
        // Nor any lengths curves: these have all points between them.
        if type_name == "Curves" {
            let n = parts.arrays.iter().find(|(name, _)| name == "points").map_or(0, |(_, a)| a.shape[0]);
            if let Some((_, Array { data: Data::U32(lengths), .. })) = parts.arrays.iter_mut().find(|(name, _)| name == "lengths") {
                let count = lengths.len();
                lengths.iter_mut().enumerate().for_each(|(i, l)| *l = (n * (i + 1) / count - n * i / count) as u32);
            }
        }
    }
}
