//! Where a path may run: bands about the diagonal, pins, and ends.

use pegbar_engine::Setting;

use super::{DtwError, Options};

/// About which line a band lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub enum BandShape {
    /// Equal frame numbers: both series at one rate, Sakoe and Chiba's own.
    SakoeChiba,
    /// The line from corner to corner, whatever the lengths.
    Slanted,
}

/// How far from a line a path may run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Band {
    /// The line.
    pub shape: BandShape,
    /// Source frames on either side.
    pub width: f64,
}

/// First and last column of each row.
pub(super) struct Window {
    pub(super) rows: Vec<[usize; 2]>,
    /// True where something is shut.
    pub(super) narrow: bool,
}

impl Window {
    pub(super) fn new(n: usize, m: usize, options: &Options) -> Result<Self, DtwError> {
        let mut rows: Vec<[usize; 2]> = (0..n).map(|i| options.band.map_or([0, m - 1], |b| b.row(i, n, m))).collect();
        for &[i, j] in &options.pins {
            if i >= n || j >= m {
                return Err(DtwError::Pin { pin: [i, j], n, m });
            }
            // Rows before a pin stay before its column, rows after it behind; a step along both would pass by it, so its own row has that column alone.
            rows[..i].iter_mut().for_each(|r| r[1] = r[1].min(j));
            rows[i + 1..].iter_mut().for_each(|r| r[0] = r[0].max(j));
            rows[i] = [rows[i][0].max(j), rows[i][1].min(j)];
        }
        let narrow = options.band.is_some() || !options.pins.is_empty();
        Ok(Self { rows, narrow })
    }
}

impl Band {
    fn row(&self, i: usize, n: usize, m: usize) -> [usize; 2] {
        let middle = match self.shape {
            BandShape::SakoeChiba => i as f64,
            BandShape::Slanted => (i * m) as f64 / n as f64,
        };
        let (first, last) = ((middle - self.width).ceil().max(0.0), (middle + self.width).floor());
        if last < 0.0 || first > (m - 1) as f64 { [1, 0] } else { [first as usize, (last as usize).min(m - 1)] }
    }
}
