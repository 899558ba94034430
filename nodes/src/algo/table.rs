//! Tables of numbers and words as CSV text, written and read.
//!
//! One line of names, then one line a row. Numbers are written in the fewest digits that read back to the same bits, with a point, never in the way
//! of a locale; cells with a comma, a quote or a line break stand in quotes, quotes within doubled. A unit is written after the name: `x [px]`.
//!
//! **Source**: RFC 4180 (Shafranovich 2005); lines end in CR LF as it asks. **Cost**: O(characters).

use std::fmt::Write as _;
use std::io::Write;

/// Why a table could not be written or read.
#[derive(Debug, thiserror::Error)]
pub enum TableError {
    /// A name is empty, or stands twice.
    #[error("expected unique column names, found `{name}` {times}")]
    Name {
        /// The name.
        name: String,
        /// "empty" or "twice".
        times: &'static str,
    },
    /// A row has too many or too few cells.
    #[error("expected {expected} cells in row {row}, found {found}")]
    Cells {
        /// Cells of the header.
        expected: usize,
        /// Cells of the row.
        found: usize,
        /// The row, from 1 below the header.
        row: usize,
    },
    /// A quote is out of place.
    #[error("expected {expected} at byte {at}; a cell is quoted as a whole, with quotes inside it doubled")]
    Quote {
        /// What was expected.
        expected: &'static str,
        /// Where, in bytes from the start.
        at: usize,
    },
    /// The writer failed.
    #[error("writing failed: {0}")]
    Io(#[from] std::io::Error),
}

/// A cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Cell<'a> {
    /// A number in double precision; NaN is an empty cell, infinities are `inf` and `-inf`.
    F64(f64),
    /// A number in single precision, likewise; fewer digits suffice.
    F32(f32),
    /// A whole number.
    Int(i64),
    /// Words.
    Text(&'a str),
}

impl Cell<'_> {
    fn push(self, out: &mut String) {
        match self {
            Cell::F64(number) => push_number(number, out),
            Cell::F32(number) => push_number(number, out),
            // Writing to a string cannot fail.
            Cell::Int(number) => drop(write!(out, "{number}")),
            Cell::Text(words) => push_quoted(words, out),
        }
    }
}

/// The head of a column.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// The name: not empty, unique in the table.
    pub name: String,
    /// The unit, as `name [unit]`; empty for none.
    pub unit: String,
}

impl Column {
    /// A column; `unit` is empty for pure numbers and words.
    pub fn new(name: impl Into<String>, unit: impl Into<String>) -> Column {
        Column { name: name.into(), unit: unit.into() }
    }

    fn title(&self) -> String {
        if self.unit.is_empty() { self.name.clone() } else { format!("{} [{}]", self.name, self.unit) }
    }
}

/// A table that is written as CSV row by row. The bytes depend on columns and cells alone; without columns there are none.
pub struct CsvWriter<W> {
    out: W,
    /// What is to be written next.
    text: String,
    columns: usize,
    rows: usize,
}

impl<W: Write> CsvWriter<W> {
    /// The header.
    ///
    /// Errors: [`TableError::Name`].
    pub fn new(columns: &[Column], out: W) -> Result<Self, TableError> {
        let mut names = std::collections::BTreeSet::new();
        for column in columns {
            let bad_name = |times| Err(TableError::Name { name: column.name.clone(), times });
            if column.name.is_empty() {
                return bad_name("empty");
            }
            if !names.insert(&column.name) {
                return bad_name("twice");
            }
        }
        let mut writer = Self { out, text: String::new(), columns: columns.len(), rows: 0 };
        let titles: Vec<String> = columns.iter().map(Column::title).collect();
        writer.line(titles.iter().map(|title| Cell::Text(title)));
        Ok(writer)
    }

    /// The next row, a cell a column.
    ///
    /// Errors: [`TableError::Cells`], `Io`.
    pub fn row(&mut self, cells: &[Cell]) -> Result<(), TableError> {
        self.rows += 1;
        if cells.len() != self.columns {
            return Err(TableError::Cells { expected: self.columns, found: cells.len(), row: self.rows });
        }
        self.line(cells.iter().copied());
        if self.text.len() > 1 << 16 {
            self.out.write_all(self.text.as_bytes())?;
            self.text.clear();
        }
        Ok(())
    }

    fn line<'a>(&mut self, cells: impl Iterator<Item = Cell<'a>>) {
        for (i, cell) in cells.enumerate() {
            self.text.push_str(if i > 0 { "," } else { "" });
            cell.push(&mut self.text);
        }
        self.text.push_str(if self.columns > 0 { "\r\n" } else { "" });
    }

    /// Writes what is still to be written.
    ///
    /// Errors: [`TableError::Io`].
    pub fn finish(mut self) -> Result<(), TableError> {
        Ok(self.out.write_all(self.text.as_bytes())?)
    }
}

/// The shortest digits that read back to the same number; very large and very small ones with an exponent.
fn push_number<T: std::fmt::LowerExp + std::fmt::Display + Copy + Into<f64>>(value: T, out: &mut String) {
    let wide: f64 = value.into();
    let size = wide.abs();
    if wide.is_nan() {
        return;
    }
    let plain = wide == 0.0 || (1e-5..1e16).contains(&size) || size.is_infinite();
    // Writing to a string cannot fail.
    let _ = if plain { write!(out, "{value}") } else { write!(out, "{value:e}") };
}

/// A cell in quotes where it needs them; an empty word is quoted, for it is not a missing number.
fn push_quoted(text: &str, out: &mut String) {
    let plain = !text.is_empty() && !text.contains([',', '"', '\r', '\n']) && text.trim() == text;
    if plain {
        return out.push_str(text);
    }
    out.push('"');
    out.push_str(&text.replace('"', "\"\""));
    out.push('"');
}

/// A table that was read: names, units and cells as text.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TextTable {
    /// The names in the header, without their units.
    pub names: Vec<String>,
    /// The unit of each column, empty where there is none.
    pub units: Vec<String>,
    /// The rows, each as many cells as there are names.
    pub rows: Vec<Vec<String>>,
}

impl TextTable {
    /// The numbers of the column `name`; `None` where it is absent or holds something else. An empty cell is NaN.
    pub fn numbers(&self, name: &str) -> Option<Vec<f64>> {
        let at = self.names.iter().position(|n| n == name)?;
        let number = |cell: &String| if cell.is_empty() { Some(f64::NAN) } else { cell.parse().ok() };
        self.rows.iter().map(|row| number(&row[at])).collect()
    }
}

/// Reads CSV text with a header line; lines may end in LF or CR LF, and the last need not end.
///
/// Errors: [`TableError::Cells`], `Quote`.
pub fn read_csv(text: &str) -> Result<TextTable, TableError> {
    let mut rows = split_rows(text)?.into_iter();
    let Some(header) = rows.next() else { return Ok(TextTable::default()) };
    let (names, units): (Vec<_>, Vec<_>) = header.iter().map(|title| split_title(title)).unzip();
    let rows: Vec<_> = rows.collect();
    for (index, row) in rows.iter().enumerate() {
        if row.len() != names.len() {
            return Err(TableError::Cells { expected: names.len(), found: row.len(), row: index + 1 });
        }
    }
    Ok(TextTable { names, units, rows })
}

fn split_title(title: &str) -> (String, String) {
    match title.strip_suffix(']').and_then(|t| t.rsplit_once(" [")) {
        Some((name, unit)) => (name.to_string(), unit.to_string()),
        None => (title.to_string(), String::new()),
    }
}

fn split_rows(text: &str) -> Result<Vec<Vec<String>>, TableError> {
    let (mut rows, mut row, mut rest) = (Vec::new(), Vec::new(), text);
    while !rest.is_empty() {
        let (cell, after) = take_cell(rest, text.len() - rest.len())?;
        row.push(cell);
        if let Some(next) = after.strip_prefix(',') {
            rest = next;
            if rest.is_empty() {
                row.push(String::new());
            }
            continue;
        }
        rest = after.strip_prefix("\r\n").or_else(|| after.strip_prefix('\n')).unwrap_or(after);
        rows.push(std::mem::take(&mut row));
    }
    if !row.is_empty() {
        rows.push(row);
    }
    Ok(rows)
}

/// The first cell of `rest`, which starts at byte `at`, and what follows it: nothing, a comma or a line end.
fn take_cell(rest: &str, at: usize) -> Result<(String, &str), TableError> {
    let Some(mut inside) = rest.strip_prefix('"') else {
        let end = rest.find([',', '\n']).unwrap_or(rest.len());
        let end = if rest[..end].ends_with('\r') && rest[end..].starts_with('\n') { end - 1 } else { end };
        return match rest[..end].find('"') {
            Some(quote) => Err(TableError::Quote { expected: "no quote within a bare cell", at: at + quote }),
            None => Ok((rest[..end].to_string(), &rest[end..])),
        };
    };
    let mut cell = String::new();
    loop {
        let Some(quote) = inside.find('"') else {
            return Err(TableError::Quote { expected: "a closing quote", at: at + rest.len() });
        };
        cell.push_str(&inside[..quote]);
        inside = &inside[quote + 1..];
        match inside.strip_prefix('"') {
            Some(next) => {
                cell.push('"');
                inside = next;
            }
            None if inside.is_empty() || inside.starts_with([',', '\n']) || inside.starts_with("\r\n") => return Ok((cell, inside)),
            None => return Err(TableError::Quote { expected: "a comma or a line end after a quote", at: at + rest.len() - inside.len() }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn csv(columns: &[(&str, &str)], rows: &[Vec<Cell>]) -> Result<String, TableError> {
        let columns: Vec<Column> = columns.iter().map(|(name, unit)| Column::new(*name, *unit)).collect();
        let mut out = Vec::new();
        let mut writer = CsvWriter::new(&columns, &mut out)?;
        rows.iter().try_for_each(|row| writer.row(row))?;
        writer.finish()?;
        Ok(String::from_utf8(out).unwrap())
    }

    #[test]
    fn a_table_is_written_as_rfc_4180_has_it() {
        let columns = [("frame", ""), ("x", "px"), ("y", "px"), ("note, \"said\"", "")];
        let rows = [
            vec![Cell::Int(1), Cell::F64(0.1), Cell::F32(0.1), Cell::Text("plain")],
            vec![Cell::Int(-2), Cell::F64(1e300), Cell::F32(-0.0), Cell::Text("a \"b\", c")],
            vec![Cell::Int(i64::MAX), Cell::F64(f64::NAN), Cell::F32(f32::INFINITY), Cell::Text("")],
        ];
        let expected = "frame,x [px],y [px],\"note, \"\"said\"\"\"\r\n1,0.1,0.1,plain\r\n-2,1e300,-0,\"a \"\"b\"\", c\"\r\n9223372036854775807,,inf,\"\"\r\n";
        assert_eq!(csv(&columns, &rows).unwrap(), expected);
        let read = read_csv(expected).unwrap();
        assert_eq!(read.names, ["frame", "x", "y", "note, \"said\""]);
        assert_eq!(read.units, ["", "px", "px", ""]);
        assert_eq!(read.rows[1][3], "a \"b\", c");
        assert!(read.numbers("x").unwrap()[2].is_nan());
        assert_eq!(read.numbers("y").unwrap()[2], f64::INFINITY);
        assert_eq!(read.numbers("z"), None);
    }

    #[test]
    fn tables_without_rows_or_columns_are_written() {
        assert_eq!(csv(&[], &[Vec::new()]).unwrap(), "");
        assert_eq!(csv(&[("a", "s")], &[]).unwrap(), "a [s]\r\n");
        assert_eq!(read_csv("").unwrap(), TextTable::default());
    }

    #[test]
    fn tables_that_contradict_themselves_are_refused() {
        let error = |columns: &[(&str, &str)]| csv(columns, &[vec![Cell::Int(0); 2], vec![Cell::Int(0)]]).unwrap_err().to_string();
        assert_eq!(error(&[("a", ""), ("b", "")]), "expected 2 cells in row 2, found 1");
        assert_eq!(error(&[("a", ""), ("a", "px")]), "expected unique column names, found `a` twice");
        assert_eq!(error(&[("", "")]), "expected unique column names, found `` empty");
    }

    #[test]
    fn text_that_is_no_table_is_refused() {
        let error = |text: &str| read_csv(text).unwrap_err().to_string();
        assert_eq!(error("a,b\n1\n"), "expected 2 cells in row 1, found 1");
        assert!(error("a\n\"open").starts_with("expected a closing quote at byte 7"));
        assert!(error("a\n\"x\"y\n").starts_with("expected a comma or a line end after a quote at byte 5"));
        assert!(error("a\nx\"y\n").starts_with("expected no quote within a bare cell at byte 3"));
    }

    #[test]
    fn line_ends_and_trailing_cells_are_read() {
        let read = read_csv("a,b\n1,\n2,3\r\n,").unwrap();
        assert_eq!(read.rows, [["1", ""], ["2", "3"], ["", ""]]);
    }

    proptest! {
        #[test]
        fn numbers_read_back_to_the_same_bits(bits in proptest::collection::vec(any::<u64>(), 1..20)) {
            let values: Vec<f64> = bits.iter().map(|b| f64::from_bits(*b)).collect();
            let singles: Vec<f32> = bits.iter().map(|b| f32::from_bits(*b as u32)).collect();
            let rows: Vec<Vec<Cell>> = values.iter().zip(&singles).map(|(d, s)| vec![Cell::F64(*d), Cell::F32(*s)]).collect();
            let text = csv(&[("d", ""), ("s", "")], &rows).unwrap();
            let read = read_csv(&text).unwrap();
            for (row, (value, single)) in values.iter().zip(&singles).enumerate() {
                let cell = &read.rows[row];
                prop_assert!(value.is_nan() && cell[0].is_empty() || cell[0].parse::<f64>().unwrap().to_bits() == value.to_bits());
                prop_assert!(single.is_nan() && cell[1].is_empty() || cell[1].parse::<f32>().unwrap().to_bits() == single.to_bits());
            }
        }

        #[test]
        fn words_read_back(words in proptest::collection::vec(proptest::collection::vec("[a\",\r\n é]{0,6}", 2), 1..8)) {
            let rows: Vec<Vec<Cell>> = words.iter().map(|row| row.iter().map(|w| Cell::Text(w)).collect()).collect();
            prop_assert_eq!(read_csv(&csv(&[("a", ""), ("b", "")], &rows).unwrap()).unwrap().rows, words);
        }

        #[test]
        fn any_text_is_read_or_refused(text in "[a,\"\r\n]{0,24}") {
            if let Ok(table) = read_csv(&text) {
                prop_assert!(table.rows.iter().all(|row| row.len() == table.names.len()));
            }
        }
    }
}
