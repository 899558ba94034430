//! Files of markers in pictures.
//!
//! CSV with a header of the columns `frame`, `name`, `x`, `y` in any order, and a row for each marker of each frame in any order; where a marker is not seen
//! `x` and `y` are empty, or there is no row. JSON with the same:
//!
//! ```json
//! { "size": [1280, 720], "names": ["pelvis", "head"], "frames": [{ "frame": 1, "points": [[640.5, 360.0], null] }] }
//! ```
//!
//! `size`, which may be left out, is the picture that the numbers are of; `points` has one for each of `names`, `null` where it is not seen.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::algo::table::{Cell, Column, CsvWriter, TableError, read_csv};

/// The most markers of a file.
pub const MAX_MARKERS: usize = 10_000;

/// Why text is no file of markers.
#[derive(Debug, Error)]
pub enum MarkerError {
    /// A cell of CSV.
    #[error("line {line}, {column}: expected {expected}, found {found}")]
    Cell {
        /// The line, from 1.
        line: usize,
        /// `column` with its name.
        column: String,
        /// What should stand there.
        expected: String,
        /// What does.
        found: String,
    },
    /// No CSV at all.
    #[error("{0}")]
    Csv(TableError),
    /// No JSON, or other fields.
    #[error("{0}")]
    Json(#[from] serde_json::Error),
    /// JSON whose parts do not fit together.
    #[error("{at}: expected {expected}, found {found}")]
    Part {
        /// Where, as `frames[3]`.
        at: String,
        /// What should stand there.
        expected: String,
        /// What does.
        found: String,
    },
}

/// Where each marker is at each frame that says something of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tracks {
    /// The markers, in the order in which they appear.
    pub names: Vec<String>,
    /// Of each marker the frames that are told, and where it is there: `None` where it is not seen.
    pub tracks: Vec<BTreeMap<i64, Option<[f64; 2]>>>,
    /// Width and height of the picture that the numbers are of, if the file says so.
    pub size: Option<[f64; 2]>,
}

/// What stands for a marker at a frame that the file says nothing of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fill {
    /// Nothing: NaN.
    Nothing,
    /// Where it was last seen; before that, where it is first.
    Hold,
    /// On the straight way from where it was last seen to where it is next; beyond its ends held.
    Straight,
}

fn blend(a: [f64; 2], b: [f64; 2], t: f64) -> [f64; 2] {
    [a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t]
}

/// Where a marker is at `frame`; NaN where it is not seen and nothing fills it.
pub fn at(track: &BTreeMap<i64, Option<[f64; 2]>>, frame: i64, fill: Fill) -> [f64; 2] {
    let seen = |(f, p): (&i64, &Option<[f64; 2]>)| p.map(|p| (*f, p));
    if let Some(Some(point)) = track.get(&frame) {
        return *point;
    }
    let before = || track.range(..frame).rev().find_map(seen);
    let after = || track.range(frame..).find_map(seen);
    match fill {
        Fill::Nothing => [f64::NAN; 2],
        Fill::Hold => before().or_else(after).map_or([f64::NAN; 2], |(_, p)| p),
        Fill::Straight => match (before(), after()) {
            (Some((f, p)), Some((g, q))) => blend(p, q, (frame - f) as f64 / (g - f) as f64),
            (one, other) => one.or(other).map_or([f64::NAN; 2], |(_, p)| p),
        },
    }
}

impl Tracks {
    fn track(&mut self, name: &str, places: &mut BTreeMap<String, usize>) -> Option<&mut BTreeMap<i64, Option<[f64; 2]>>> {
        let at = *places.entry(name.to_owned()).or_insert(self.names.len());
        if at == self.names.len() {
            if at == MAX_MARKERS {
                return None;
            }
            self.names.push(name.to_owned());
            self.tracks.push(BTreeMap::new());
        }
        self.tracks.get_mut(at)
    }
}

const COLUMNS: [&str; 4] = ["frame", "name", "x", "y"];

/// Reads CSV. O(characters · log).
///
/// # Errors
/// Where a column is unknown or missing, a cell is no number, or a frame has two markers of one name: with line and column.
pub fn read_csv_markers(text: &str) -> Result<Tracks, MarkerError> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text).trim_end();
    let table = read_csv(text).map_err(|e| match e {
        TableError::Cells { expected, found, row } => cell(row + 1, "the row".to_owned(), format!("{expected} cells"), found.to_string()),
        other => MarkerError::Csv(other),
    })?;
    let columns = columns(&table.names, &table.units)?;
    let (mut found, mut places, mut lines) = (Tracks::default(), BTreeMap::new(), BTreeMap::new());
    let mut line = 2;
    for row in &table.rows {
        let [frame, name, x, y] = columns.map(|c| row[c].trim());
        let said = |k: usize, expected: &str| {
            cell(line, format!("column `{}`", COLUMNS[k]), expected.to_owned(), format!("`{}`", row[columns[k]]))
        };
        let frame: i64 = frame.parse().map_err(|_| said(0, "a whole number"))?;
        if name.is_empty() {
            return Err(said(1, "a name"));
        }
        let number = |k: usize, text: &str| {
            let expected = "a number, or nothing where the marker is not seen";
            text.parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(|| said(k, expected))
        };
        let point = if x.is_empty() && y.is_empty() { None } else { Some([number(2, x)?, number(3, y)?]) };
        let too_many = || said(1, &format!("at most {MAX_MARKERS} markers"));
        let track = found.track(name, &mut places).ok_or_else(too_many)?;
        if track.insert(frame, point).is_some() {
            let before: usize = lines.get(&(places[name], frame)).copied().unwrap_or_default();
            return Err(said(1, &format!("each marker once a frame, `{name}` at frame {frame} stands in line {before}")));
        }
        lines.insert((places[name], frame), line);
        // Cells in quotes may have lines of their own.
        line += 1 + row.iter().map(|c| c.matches('\n').count()).sum::<usize>();
    }
    Ok(found)
}

fn cell(line: usize, column: String, expected: String, found: String) -> MarkerError {
    MarkerError::Cell { line, column, expected, found }
}

/// Where the four columns stand.
fn columns(names: &[String], units: &[String]) -> Result<[usize; 4], MarkerError> {
    let header = |expected: &str, found: String| cell(1, "the header".to_owned(), expected.to_owned(), found);
    let expected = "the columns frame, name, x, y";
    let mut at = [None; 4];
    for (i, (name, unit)) in names.iter().zip(units).enumerate() {
        match COLUMNS.iter().position(|c| name.trim().eq_ignore_ascii_case(c)) {
            Some(k) if at[k].is_none() => at[k] = Some(i),
            Some(_) => return Err(header(expected, format!("`{name}` twice"))),
            None => return Err(header(expected, format!("`{name}`"))),
        }
        if !unit.is_empty() && unit != "px" {
            return Err(header("the unit px, or none", format!("`{unit}`")));
        }
    }
    match at {
        [Some(a), Some(b), Some(c), Some(d)] => Ok([a, b, c, d]),
        _ => {
            let missing: Vec<&str> = COLUMNS.iter().zip(at).filter(|(_, a)| a.is_none()).map(|(c, _)| *c).collect();
            Err(header(expected, format!("none called {}", missing.join(", "))))
        }
    }
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct JsonFile {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    size: Option<[f64; 2]>,
    names: Vec<String>,
    frames: Vec<JsonFrame>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct JsonFrame {
    frame: i64,
    points: Vec<Option<[f64; 2]>>,
}

/// Reads JSON. O(characters).
///
/// # Errors
/// Where the text is no JSON of that form (with line and column), names or frames stand twice, or a frame has other points than there are names.
pub fn read_json_markers(text: &str) -> Result<Tracks, MarkerError> {
    let file: JsonFile = serde_json::from_str(text.strip_prefix('\u{feff}').unwrap_or(text))?;
    let part = |at: String, expected: String, found: String| MarkerError::Part { at, expected, found };
    let n = file.names.len();
    if n > MAX_MARKERS {
        return Err(part("names".to_owned(), format!("at most {MAX_MARKERS} markers"), n.to_string()));
    }
    let mut places = BTreeMap::new();
    for (k, name) in file.names.iter().enumerate() {
        if name.is_empty() || places.insert(name, k).is_some() {
            return Err(part(format!("names[{k}]"), "a name, each once".to_owned(), format!("{name:?}")));
        }
    }
    if let Some(size) = file.size.filter(|s| !s.iter().all(|v| *v >= 1.0)) {
        return Err(part("size".to_owned(), "width and height of a picture".to_owned(), format!("{size:?}")));
    }
    let mut tracks = vec![BTreeMap::new(); n];
    for (k, row) in file.frames.into_iter().enumerate() {
        if row.points.len() != n {
            return Err(part(
                format!("frames[{k}].points"),
                format!("{n} points, one for each of the names"),
                row.points.len().to_string(),
            ));
        }
        for (track, point) in tracks.iter_mut().zip(row.points) {
            if track.insert(row.frame, point).is_some() {
                return Err(part(format!("frames[{k}].frame"), "each frame once".to_owned(), format!("{} again", row.frame)));
            }
        }
    }
    Ok(Tracks { names: file.names, tracks, size: file.size })
}

/// CSV of markers: a row for each at each frame, numbers in the fewest digits that read back to the same bits, none where one is not seen.
///
/// # Errors
/// None but those of the writer: names may be any.
pub fn write_csv_markers<W: std::io::Write>(names: &[String], frames: &[(i64, Vec<[f64; 2]>)], out: W) -> Result<(), TableError> {
    let units = ["", "", "px", "px"];
    let columns: Vec<Column> = COLUMNS.iter().zip(units).map(|(c, u)| Column::new(*c, u)).collect();
    let mut table = CsvWriter::new(&columns, out)?;
    for (frame, points) in frames {
        for (name, [x, y]) in names.iter().zip(points) {
            table.row(&[Cell::Int(*frame), Cell::Text(name), Cell::F64(*x), Cell::F64(*y)])?;
        }
    }
    table.finish()
}

/// JSON of markers, a line a frame.
///
/// # Errors
/// None but those of the writer.
pub fn write_json_markers(size: Option<[f64; 2]>, names: &[String], frames: &[(i64, Vec<[f64; 2]>)]) -> Result<String, serde_json::Error> {
    let mut out = String::from("{\n");
    // Writing to a string cannot fail.
    if let Some(size) = size {
        let _ = writeln!(out, "\"size\": {},", serde_json::to_string(&size)?);
    }
    let _ = writeln!(out, "\"names\": {},\n\"frames\": [", serde_json::to_string(names)?);
    for (k, (frame, points)) in frames.iter().enumerate() {
        let points = points.iter().map(|p| p.iter().all(|v| v.is_finite()).then_some(*p)).collect();
        let row = serde_json::to_string(&JsonFrame { frame: *frame, points })?;
        let _ = writeln!(out, "{row}{}", if k + 1 < frames.len() { "," } else { "" });
    }
    out.push_str("]\n}\n");
    Ok(out)
}
