//! Affine maps of the plane.

use pegbar_engine::Value;
use pegbar_engine::setting::{Setting, SettingError};

use crate::algo::raster::Affine;

/// An affine map of the plane, target from source, in pixels.
#[derive(Clone, Debug, PartialEq, Value)]
#[value(literal = "parse", form = "[a1, a2, a3, a4, dx, dy]")]
pub struct Affine2 {
    /// Rows `[a1, a2, dx]` and `[a3, a4, dy]`: x' = a1 x + a2 y + dx, y' = a3 x + a4 y + dy; pixels, origin at the top left corner of the format.
    #[value(shape = "[2, 3]")]
    pub matrix: [[f64; 3]; 2],
}

impl From<Affine> for Affine2 {
    fn from(m: Affine) -> Self {
        Self { matrix: [[m[(0, 0)], m[(0, 1)], m[(0, 2)]], [m[(1, 0)], m[(1, 1)], m[(1, 2)]]] }
    }
}

impl From<&Affine2> for Affine {
    fn from(a: &Affine2) -> Self {
        let [[a1, a2, dx], [a3, a4, dy]] = a.matrix;
        Affine::new(a1, a2, dx, a3, a4, dy)
    }
}

fn parse(text: &str) -> Result<Affine2, SettingError> {
    let numbers = Vec::<f64>::parse(text)?;
    match numbers[..] {
        [a1, a2, a3, a4, dx, dy] => Ok(Affine2 { matrix: [[a1, a2, dx], [a3, a4, dy]] }),
        _ => Err(SettingError::whole(text, format!("expected six numbers [a1, a2, a3, a4, dx, dy], found {}", numbers.len()))),
    }
}
