//! `io.write_table`: numbers of any values to a `.csv` file, one row a frame.
//!
//! Every number of every value is a column: a curve is one, a vector of three is `name[0]`, `name[1]`, `name[2]`, a matrix `name[0][0]` and so on; a
//! value of several arrays has the array's name between, as `name.points[0][1]`. The first column is the frame, and a value that does not change
//! stands in every row. Numbers are written in the fewest digits that read back to the same bits.
//!
//! **Source**: RFC 4180 (Shafranovich 2005). **Fails when** values tick to several clocks, or change their shape from frame to frame. **Cost**:
//! O(numbers); all frames are in memory.
//!
//! ```ron
//! Graph(pegbar: 1, frames: (first: 1, last: 24, fps: 24), nodes: {
//!     "in": (type: "io.read_value", path: "weights.npz", as: "Weights"),
//!     "out": (type: "io.write_table", values: ["@in"], names: ["weight"], path: "$out/weights.csv"),
//! })
//! ```

use pegbar_engine::Node;
use pegbar_engine::array::{ArrayView, DType, Shape};
use pegbar_engine::node::{AnySequence, Context, Fault, List, NodeError, Problem, Whole};
use pegbar_engine::setting::OutputPath;
use pegbar_engine::value::ValueRef;

use crate::algo::table::{Cells, Column, write_csv};

use super::file;

/// The most columns of a table: more is a picture or a mesh rather than a table.
const MAX_COLUMNS: usize = 16_384;

/// Writes numbers to a `.csv` table, one row a frame.
#[derive(Node)]
#[node(
    id = "io.write_table",
    version = 1,
    kind = whole,
    source = "RFC 4180",
    example = "\"curves\": (type: \"io.write_table\", values: [\"@track.motion\", \"@track.residual\"], path: \"$out/motion.csv\")"
)]
pub(crate) struct IoWriteTable {
    /// The values: streams on one clock, or values that do not change.
    values: List<AnySequence>,
    /// The file, inside the output folder, ending in .csv.
    path: OutputPath,
    /// A name for each value, in their order; those without are called by their types.
    #[input(default = [])]
    names: Vec<String>,
    /// A unit for each value, in their order, as `"px"`; empty for none.
    #[input(default = [])]
    units: Vec<String>,
}

impl Whole for IoWriteTable {
    fn check(&self) -> Vec<Problem> {
        let path = self.path.at(0);
        let mut problems = Vec::new();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if !path.extension().is_some_and(|e| e.eq_ignore_ascii_case("csv")) {
            problems.push(Problem { input: "path", message: format!("expected a path ending in .csv, found {name}") });
        }
        if self.path.is_sequence() {
            problems
                .push(Problem { input: "path", message: "expected one file for all frames, found a frame number in the path".to_owned() });
        }
        problems
    }

    fn run(self, cx: &Context) -> Result<(), NodeError> {
        let sequences = &self.values.0;
        for (input, list) in [("names", &self.names), ("units", &self.units)] {
            if list.len() > sequences.len() {
                let message = format!("input `{input}`: expected at most one for each of {} values, found {}", sequences.len(), list.len());
                return Err(NodeError::new(Fault::Parameters, message));
            }
        }
        let mut columns = Vec::new();
        let rows = self.frames(&mut columns)?;
        let names = self.column_names()?;
        for (i, sequence) in sequences.iter().enumerate() {
            cx.check()?;
            let unit = self.units.get(i).map_or("", String::as_str);
            add_columns(&names[i], unit, &sequence.gather()?, rows, &mut columns)?;
        }
        file::write(&self.path.at(0), Fault::Parameters, |out| write_csv(&columns, out))
    }
}

impl IoWriteTable {
    /// The number of rows; where anything changes over time, the column of frames.
    fn frames(&self, columns: &mut Vec<Column>) -> Result<usize, NodeError> {
        let mut clocks = self.values.0.iter().filter_map(AnySequence::clock);
        let Some(clock) = clocks.next() else { return Ok(1) };
        if let Some(other) = clocks.find(|c| *c != clock) {
            let message = format!("expected values of one clock, found `{}` and `{}`", clock.name, other.name);
            return Err(NodeError::input(message).help("a node that changes time goes between: time.hold, time.resample or retime.apply"));
        }
        columns.push(Column::new("frame", "", Cells::Int(clock.frames().collect())));
        Ok(clock.len())
    }

    /// A name for each value: as given, else its type's in small letters, numbered where several would be the same.
    fn column_names(&self) -> Result<Vec<String>, NodeError> {
        let mut names: Vec<String> = self.names.clone();
        for sequence in self.values.0.iter().skip(self.names.len()) {
            let base = if sequence.is_empty() { "value".to_owned() } else { sequence.get(0)?.type_name().to_lowercase() };
            let numbered = (2..).map(|n| format!("{base}_{n}"));
            let free = std::iter::once(base.clone()).chain(numbered).find(|n| !names.contains(n));
            names.push(free.unwrap_or(base));
        }
        Ok(names)
    }
}

fn add_columns(name: &str, unit: &str, values: &[ValueRef], rows: usize, columns: &mut Vec<Column>) -> Result<(), NodeError> {
    let parts: Vec<_> = values.iter().map(|v| v.parts()).collect();
    let Some(first) = parts.first() else { return Ok(()) };
    for (a, (array_name, array)) in first.arrays.iter().enumerate() {
        let title = if first.arrays.len() == 1 { name.to_owned() } else { format!("{name}.{array_name}") };
        let mut frames = Vec::with_capacity(rows);
        for part in &parts {
            match part.arrays.get(a) {
                Some((_, view)) if view.shape == array.shape && view.dtype == array.dtype => frames.push(view),
                _ => {
                    let message = format!(
                        "expected `{title}` of the same shape at every frame, found several: write it with `io.write_value` and #### in the path"
                    );
                    return Err(NodeError::input(message));
                }
            }
        }
        // A value that does not change stands in every row.
        if let (1, Some(&only)) = (frames.len(), frames.first()) {
            frames.resize(rows, only);
        }
        let count = array.shape.iter().product::<usize>();
        if columns.len() + count > MAX_COLUMNS {
            return Err(NodeError::new(Fault::Limit, format!("expected at most {MAX_COLUMNS} columns, found {count} more in `{title}`")));
        }
        columns.extend((0..count).map(|k| Column::new(format!("{title}{}", suffix(&array.shape, k)), unit, cells(&frames, k))));
    }
    Ok(())
}

/// `[1][2]`: where the element `k` stands in an array of these extents.
fn suffix(shape: &Shape, mut k: usize) -> String {
    let mut indices = Vec::with_capacity(shape.len());
    for &axis in shape.iter().rev() {
        indices.push(k % axis);
        k /= axis;
    }
    indices.iter().rev().map(|i| format!("[{i}]")).collect()
}

/// The element `k` of each array.
fn cells(frames: &[&ArrayView], k: usize) -> Cells {
    fn column<const N: usize, T>(frames: &[&ArrayView], k: usize, read: fn([u8; N]) -> T) -> Vec<T> {
        frames.iter().filter_map(|f| f.bytes.as_chunks::<N>().0.get(k).map(|b| read(*b))).collect()
    }
    match frames.first().map_or(DType::F64, |f| f.dtype) {
        DType::F64 => Cells::F64(column(frames, k, f64::from_ne_bytes)),
        DType::F32 => Cells::F32(column(frames, k, f32::from_ne_bytes)),
        DType::I64 => Cells::Int(column(frames, k, i64::from_ne_bytes)),
        DType::U32 => Cells::Int(column(frames, k, |b| i64::from(u32::from_ne_bytes(b)))),
        DType::U8 => Cells::Int(column(frames, k, |b: [u8; 1]| i64::from(b[0]))),
    }
}
