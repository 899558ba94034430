//! `io.write_table`: numbers of any values to a `.csv` file, one row a frame.
//!
//! Every number of every value is a column: a curve is one, a vector of three is `name[0]`, `name[1]`, `name[2]`, a matrix `name[0][0]` and so on; a
//! value of several arrays has the array's name between, as `name.points[0][1]`, and a table its own names, as `name[left_knee][rms]`. The first column is the
//! frame, and a value that does not change stands in every row. Tables alone, none of which changes, are written as they are: a row for each of theirs, by
//! its name, and a column `name.rms` for each of theirs. Numbers are written in the fewest digits that read back to the same bits.
//!
//! **Source**: RFC 4180 (Shafranovich 2005). **Fails when** values tick to several clocks, or change their shape from frame to frame, or tables have other
//! rows. **Cost**: O(numbers); one value is in memory.
//!
//! ```ron
//! Graph(pegbar: 1, frames: (first: 1, last: 24, fps: 24), nodes: {
//!     "in": (type: "io.read_value", path: "weights.npz", as: "Weights"),
//!     "out": (type: "io.write_table", values: ["@in"], names: ["weight"], path: "$out/weights.csv"),
//! })
//! ```

use std::sync::Arc;

use pegbar_engine::Node;
use pegbar_engine::array::{ArrayView, DType, Shape};
use pegbar_engine::clock::Clock;
use pegbar_engine::node::{AnySequence, Context, Fault, List, NodeError, Problem, Whole};
use pegbar_engine::setting::OutputPath;
use pegbar_engine::value::{ValueRef, downcast};

use crate::algo::table::{Cell, Column, CsvWriter, TableError};
use crate::data::Table;

use super::file;

/// The most columns of a table: more is a picture or a mesh rather than a table.
const MAX_COLUMNS: usize = 16_384;

/// Writes numbers to a `.csv` table, one row a frame.
#[derive(Node)]
#[node(
    id = "io.write_table",
    version = 2,
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
        let clock = self.clock()?;
        let names = self.column_names()?;
        if let Some(tables) = self.tables()? {
            return self.write_rows(&tables, &names);
        }
        let mut columns: Vec<Column> = clock.iter().map(|_| Column::new("frame", "")).collect();
        let mut sources = Vec::new();
        for (i, name) in names.iter().enumerate().filter(|(i, _)| !sequences[*i].is_empty()) {
            let unit = self.units.get(i).map_or("", String::as_str);
            sources.push(Source::new(&sequences[i], name, unit, &mut columns)?);
        }
        file::write_read(&self.path.at(0), |out| {
            let mut table = CsvWriter::new(&columns, out).map_err(table_error)?;
            for row in 0..clock.map_or(1, Clock::len) {
                cx.check()?;
                let mut cells: Vec<Cell> = clock.iter().map(|c| Cell::Int(c.first + row as i64)).collect();
                sources.iter().try_for_each(|source| source.push_cells(row, &mut cells))?;
                table.row(&cells).map_err(table_error)?;
            }
            table.finish().map_err(table_error)
        })
    }
}

fn table_error(error: TableError) -> NodeError {
    let fault = if matches!(error, TableError::Io(_)) { Fault::Io } else { Fault::Parameters };
    NodeError::new(fault, error.to_string())
}

impl IoWriteTable {
    /// The clock, where anything changes over time.
    fn clock(&self) -> Result<Option<&Clock>, NodeError> {
        let mut clocks = self.values.0.iter().filter_map(AnySequence::clock);
        let Some(clock) = clocks.next() else { return Ok(None) };
        if let Some(other) = clocks.find(|c| *c != clock) {
            let message = format!("expected values of one clock, found `{}` and `{}`", clock.name, other.name);
            return Err(NodeError::input(message).help("a node that changes time goes between: time.hold, time.resample or retime.apply"));
        }
        Ok(Some(clock))
    }

    /// The values, where they are tables that do not change.
    fn tables(&self) -> Result<Option<Vec<Arc<Table>>>, NodeError> {
        let single = |s: &AnySequence| if s.len() == 1 && s.clock().is_none() { s.get(0).map(downcast::<Table>) } else { Ok(None) };
        let tables = self.values.0.iter().map(single).collect::<Result<Option<Vec<_>>, _>>()?;
        Ok(tables.filter(|t| !t.is_empty()))
    }

    /// Tables side by side, one row for each of theirs.
    fn write_rows(&self, tables: &[Arc<Table>], names: &[String]) -> Result<(), NodeError> {
        let n = tables[0].values.shape()[0];
        if let Some(k) = tables.iter().position(|t| t.rows != tables[0].rows || t.values.shape()[0] != n) {
            let message = format!("expected tables of the same rows, found others in `{}` and `{}`", names[0], names[k]);
            return Err(NodeError::input(message).help("write them to a file each"));
        }
        let mut columns = vec![Column::new("row", "")];
        for (i, (table, name)) in tables.iter().zip(names).enumerate() {
            let unit = self.units.get(i).map_or("", String::as_str);
            let title = |k: usize| table.columns.get(k).map_or_else(|| format!("{name}[{k}]"), |column| format!("{name}.{column}"));
            columns.extend((0..table.values.shape()[1]).map(|k| Column::new(title(k), unit)));
        }
        file::write_read(&self.path.at(0), |out| {
            let mut csv = CsvWriter::new(&columns, out).map_err(table_error)?;
            for row in 0..n {
                let mut cells = vec![tables[0].rows.get(row).map_or(Cell::Int(row as i64), |name| Cell::Text(name))];
                for table in tables {
                    let k = table.values.shape()[1];
                    cells.extend(table.values.data()[row * k..(row + 1) * k].iter().map(|v| Cell::F64(*v)));
                }
                csv.row(&cells).map_err(table_error)?;
            }
            csv.finish().map_err(table_error)
        })
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

/// Where the cells of some columns come from.
struct Source<'a> {
    values: &'a AnySequence,
    /// A value that does not change stands in every row.
    held: Option<ValueRef>,
    /// Each array of a value, as it must be at every frame.
    arrays: Vec<Layout>,
}

struct Layout {
    title: String,
    dtype: DType,
    shape: Shape,
}

impl<'a> Source<'a> {
    /// Adds a column for each number of the first value.
    fn new(values: &'a AnySequence, name: &str, unit: &str, columns: &mut Vec<Column>) -> Result<Self, NodeError> {
        let first = values.get(0)?;
        let table = downcast::<Table>(first.clone());
        let parts = first.parts();
        let mut arrays = Vec::with_capacity(parts.arrays.len());
        for (array_name, ArrayView { dtype, shape, .. }) in &parts.arrays {
            let title = if parts.arrays.len() == 1 { name.to_owned() } else { format!("{name}.{array_name}") };
            let count = shape.iter().product::<usize>();
            if columns.len() + count > MAX_COLUMNS {
                return Err(NodeError::new(
                    Fault::Limit,
                    format!("expected at most {MAX_COLUMNS} columns, found {count} more in `{title}`"),
                ));
            }
            let place = |k: usize| table.as_ref().map_or_else(|| suffix(shape, k), |t| named(t, k));
            columns.extend((0..count).map(|k| Column::new(format!("{title}{}", place(k)), unit)));
            arrays.push(Layout { title, dtype: *dtype, shape: *shape });
        }
        drop(parts);
        Ok(Self { values, held: (values.len() == 1).then_some(first), arrays })
    }

    /// All numbers of the value in a row.
    fn push_cells(&self, row: usize, cells: &mut Vec<Cell>) -> Result<(), NodeError> {
        let value = self.held.clone().map_or_else(|| self.values.get(row), Ok)?;
        let parts = value.parts();
        for (i, Layout { title, dtype, shape }) in self.arrays.iter().enumerate() {
            match parts.arrays.get(i) {
                Some((_, view)) if view.shape == *shape && view.dtype == *dtype => push_numbers(view, cells),
                _ => {
                    let message = format!(
                        "expected `{title}` of the same shape at every frame, found several: write it with `io.write_value` and #### in the path"
                    );
                    return Err(NodeError::input(message));
                }
            }
        }
        Ok(())
    }
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

/// `[left_knee][rms]`: where the number `k` of a table stands, by names where it has them.
fn named(table: &Table, k: usize) -> String {
    let width = table.values.shape()[1];
    let one = |names: &[String], at: usize| names.get(at).map_or_else(|| format!("[{at}]"), |name| format!("[{name}]"));
    one(&table.rows, k / width) + &one(&table.columns, k % width)
}

fn push_numbers<'c>(view: &ArrayView, cells: &mut Vec<Cell<'c>>) {
    fn each<'c, const N: usize>(bytes: &[u8], cell: fn([u8; N]) -> Cell<'c>) -> impl Iterator<Item = Cell<'c>> {
        bytes.as_chunks::<N>().0.iter().map(move |b| cell(*b))
    }
    let bytes = view.bytes;
    match view.dtype {
        DType::F64 => cells.extend(each(bytes, |b| Cell::F64(f64::from_ne_bytes(b)))),
        DType::F32 => cells.extend(each(bytes, |b| Cell::F32(f32::from_ne_bytes(b)))),
        DType::I64 => cells.extend(each(bytes, |b| Cell::Int(i64::from_ne_bytes(b)))),
        DType::U32 => cells.extend(each(bytes, |b| Cell::Int(i64::from(u32::from_ne_bytes(b))))),
        DType::U8 => cells.extend(each(bytes, |b: [u8; 1]| Cell::Int(i64::from(b[0])))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::counted::{clock, counted};
    use pegbar_engine::array::NdArray;
    use pegbar_engine::node::Cancel;
    use pegbar_engine::node::{Arg, SequenceRef};
    use pegbar_engine::setting::{Place, Setting};
    use pegbar_engine::value::{Curve, Vector};

    #[test]
    fn one_value_is_held_at_a_time() {
        let folder = tempfile::tempdir().unwrap();
        let path = OutputPath::parse("\"table.csv\"").unwrap().bind(&Place { out: folder.path().to_owned(), ..Place::default() });
        let (curve, curves) = counted(3, |k| Curve { value: k as f64 });
        let (vector, vectors) = counted(3, |k| Vector { values: vec![k as f64, 0.5] });
        let node = IoWriteTable { values: List(vec![curve, vector]), path, names: Vec::new(), units: Vec::new() };
        let (clock, cancel) = (clock(3), Cancel::default());
        node.run(&Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &cancel }).unwrap();
        let text = std::fs::read_to_string(folder.path().join("table.csv")).unwrap();
        assert_eq!(text, "frame,curve,vector[0],vector[1]\r\n1,0,0,0.5\r\n2,1,1,0.5\r\n3,2,2,0.5\r\n");
        assert_eq!((curves.peak(), vectors.peak()), (1, 1));
    }

    fn written(values: Vec<AnySequence>, names: &[&str]) -> Result<String, NodeError> {
        let folder = tempfile::tempdir().unwrap();
        let path = OutputPath::parse("\"table.csv\"").unwrap().bind(&Place { out: folder.path().to_owned(), ..Place::default() });
        let names = names.iter().map(|n| (*n).to_owned()).collect();
        let node = IoWriteTable { values: List(values), path, names, units: vec!["m".to_owned()] };
        let (clock, cancel) = (clock(2), Cancel::default());
        node.run(&Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &cancel })?;
        Ok(std::fs::read_to_string(folder.path().join("table.csv")).unwrap())
    }

    fn table(rows: &[&str]) -> AnySequence {
        let values = NdArray::new([2, 2], vec![1.0, 2.0, 3.0, f64::NAN]).unwrap();
        let names = |list: &[&str]| list.iter().map(|n| (*n).to_owned()).collect::<Vec<_>>();
        let table = Table { values, rows: names(rows), columns: names(&["rms", "max"]) };
        let values: Vec<ValueRef> = vec![Arc::new(table)];
        <AnySequence as pegbar_engine::node::Input>::from_arg(Arg::Sequence(SequenceRef::new(None, values))).unwrap()
    }

    #[test]
    fn tables_are_written_by_their_rows() {
        let text = written(vec![table(&["neck", "head"]), table(&["neck", "head"])], &["a", "b"]).unwrap();
        assert_eq!(text, "row,a.rms [m],a.max [m],b.rms,b.max\r\nneck,1,2,1,2\r\nhead,3,,3,\r\n");
        assert_eq!(written(vec![table(&[])], &["a"]).unwrap(), "row,a.rms [m],a.max [m]\r\n0,1,2\r\n1,3,\r\n");
        let error = written(vec![table(&["neck", "head"]), table(&["neck", "tail"])], &["a", "b"]).unwrap_err();
        assert_eq!(error.message, "expected tables of the same rows, found others in `a` and `b`");
    }

    #[test]
    fn tables_beside_values_that_change_are_named_in_the_head() {
        let (curve, _) = counted(2, |k| Curve { value: k as f64 });
        let text = written(vec![table(&["neck", "head"]), curve], &["a"]).unwrap();
        assert_eq!(
            text.lines().collect::<Vec<_>>(),
            ["frame,a[neck][rms] [m],a[neck][max] [m],a[head][rms] [m],a[head][max] [m],curve", "1,1,2,3,,0", "2,1,2,3,,1"]
        );
    }
}
