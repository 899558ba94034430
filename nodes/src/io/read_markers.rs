//! `io.read_markers`: marked points of drawings from CSV or JSON.
//!
//! CSV has a header of the columns `frame`, `name`, `x`, `y`, and a row for each marker of each frame, in any order; `x` and `y` are empty where it is not
//! seen. JSON has the same as `{ "size": [1280, 720], "names": ["pelvis", "head"], "frames": [{ "frame": 1, "points": [[640.5, 360.0], null] }] }`, where
//! `size`, the picture that the numbers are of, may be left out. Frames are those of the clock.
//!
//! **Source**: Jain, Sheikh, Hodgins 2009, section 3.1 (markers on each drawing); RFC 4180; RFC 8259. **Fails when** a column is unknown, a cell is no
//! number, a frame has two markers of one name or lacks one: with line and column; and where, the picture's size being known, the numbers are in another
//! unit than its pixels. **Cost**: O(bytes · log).
//!
//! ```ron
//! Graph(pegbar: 1, frames: (first: 1, last: 24, fps: 24), nodes: {
//!     "marked": (type: "io.read_markers", path: "walk.csv", size: (1280, 720), missing: hold),
//! }, outputs: { "markers": "@marked" })
//! ```

use std::path::Path;

use pegbar_engine::diag::did_you_mean;
use pegbar_engine::node::{Context, NodeError, Problem, Stream, Whole};
use pegbar_engine::setting::{ClockName, InputPath};
use pegbar_engine::{Node, Outputs, Setting};

use super::capture::{refused, text};
use crate::algo::markers::table::{Fill, Tracks, at, read_csv_markers, read_json_markers};
use crate::data::Markers2;

/// What stands for a marker at a frame that the file says nothing of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum Unmarked {
    /// An error that names marker and frame. A marker that the file says is not seen is none: it is NaN.
    Error,
    /// Where it was last seen; before that, where it is first.
    Hold,
    /// Nothing: it is not seen.
    Nan,
    /// On the straight way from where it was last seen to where it is next; held beyond its ends.
    Interpolate,
}

/// What the numbers count.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum Units {
    /// Pixels.
    Px,
    /// Widths and heights of the picture: 0.5, 0.5 is its middle.
    Fraction,
}

/// Where the numbers count from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum Origin {
    /// The top left corner, y down.
    Top,
    /// The bottom left corner, y up.
    Bottom,
}

/// Reads marked points of drawings: `.csv` or `.json`.
#[derive(Node)]
#[node(
    id = "io.read_markers",
    version = 1,
    kind = whole,
    outputs = IoReadMarkersOutputs,
    source = "Jain, Sheikh, Hodgins 2009, section 3.1; RFC 4180; RFC 8259",
    example = "\"marked\": (type: \"io.read_markers\", path: \"walk.csv\", size: (1280, 720), missing: hold)"
)]
pub(crate) struct IoReadMarkers {
    /// The file, from the graph's folder, ending in .csv or .json.
    path: InputPath,
    /// The markers that are read, in this order. All, as the file has them, where it is left out.
    #[input(default = [])]
    names: Vec<String>,
    /// What stands for a marker at a frame that the file says nothing of.
    #[input(default = error)]
    missing: Unmarked,
    /// Width and height of the picture: markers far from it are an error. Numbers of a file that has another size are brought to this one.
    #[input(default = None, range = 1..=65536, unit = "px")]
    size: Option<[i64; 2]>,
    /// What the numbers count.
    #[input(default = px)]
    units: Units,
    /// Where the numbers count from.
    #[input(default = top)]
    origin: Origin,
    /// What all numbers are multiplied by: 2 where points were marked on pictures of half the size.
    #[input(default = 1.0, range = 0.000001..=1000000.0)]
    scale: f64,
    /// What is added to the frame numbers of the file.
    #[input(default = 0, range = -1000000000..=1000000000, unit = "frames")]
    offset: i64,
    /// The clock whose frames are read; `None` for the graph's own.
    #[input(default = None)]
    #[allow(dead_code, reason = "the checker reads it")]
    clock: Option<ClockName>,
}

/// The markers.
#[derive(Outputs)]
pub(crate) struct IoReadMarkersOutputs {
    /// Where each is: pixels, NaN where it is not seen.
    markers: Stream<Markers2>,
}

fn is_json(path: &Path) -> Result<bool, String> {
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    match extension.as_str() {
        "json" => Ok(true),
        "csv" => Ok(false),
        other => Err(format!("expected a path ending in .csv or .json, found {other:?}")),
    }
}

impl IoReadMarkers {
    /// The tracks that are read, each with its name.
    fn chosen(&self, tracks: &Tracks) -> Result<Vec<usize>, String> {
        if self.names.is_empty() {
            return Ok((0..tracks.names.len()).collect());
        }
        let one = |name: &String| {
            tracks.names.iter().position(|n| n == name).ok_or_else(|| {
                let like = did_you_mean(name, tracks.names.iter().map(String::as_str));
                let like = like.map_or_else(String::new, |l| format!("; did you mean `{l}`?"));
                format!("expected a marker `{name}`, found {}{like}", tracks.names.join(", "))
            })
        };
        self.names.iter().map(one).collect()
    }

    /// From the file's numbers to pixels.
    fn pixels(&self, own: Option<[f64; 2]>) -> Result<impl Fn([f64; 2]) -> [f64; 2], String> {
        let wanted = self.size.map(|s| s.map(|n| n as f64));
        let size = wanted.or(own);
        if size.is_none() && (self.units == Units::Fraction || self.origin == Origin::Bottom) {
            return Err("expected `size`, which fractions and an origin at the bottom are of, found none".to_owned());
        }
        let [w, h] = size.unwrap_or([1.0; 2]);
        let factor = match (self.units, own, wanted) {
            (Units::Fraction, ..) => [w, h],
            (_, Some(own), Some(_)) => [w / own[0], h / own[1]],
            _ => [1.0; 2],
        };
        let factor = factor.map(|f| f * self.scale);
        let from_bottom = self.origin == Origin::Bottom;
        Ok(move |p: [f64; 2]| [p[0] * factor[0], if from_bottom { h - p[1] * factor[1] } else { p[1] * factor[1] }])
    }

    /// That numbers are in the unit that they are said to be in, as far as the picture tells.
    fn expect_units(&self, tracks: &Tracks, chosen: &[usize], pixels: impl Fn([f64; 2]) -> [f64; 2]) -> Result<(), String> {
        let points = || chosen.iter().flat_map(|&t| tracks.tracks[t].values()).flatten();
        let n = points().count();
        let largest = points().flatten().fold(0.0f64, |m, v| m.max(v.abs()));
        if self.units == Units::Fraction && largest > 4.0 {
            return Err(format!("expected fractions of the picture, found numbers up to {largest}: they look like pixels, `units: px`"));
        }
        let is_small = self.units == Units::Px && n > 1 && largest * self.scale <= 1.5;
        if self.size.is_none() && tracks.size.is_none() && is_small && n > 3 {
            return Err(format!(
                "expected pixels, found no number above {largest}: they look like fractions, `units: fraction` with a `size`"
            ));
        }
        let Some([w, h]) = self.size.map(|s| s.map(|n| n as f64)).or(tracks.size) else { return Ok(()) };
        if is_small && w.min(h) >= 16.0 {
            return Err(format!(
                "expected pixels of a picture of {w} x {h}, found no number above {largest}: they look like fractions, `units: fraction`"
            ));
        }
        let is_near = |p: &&[f64; 2]| {
            let [x, y] = pixels(**p);
            (-0.5 * w..=1.5 * w).contains(&x) && (-0.5 * h..=1.5 * h).contains(&y)
        };
        let near = points().filter(is_near).count();
        if 2 * near >= n {
            return Ok(());
        }
        let why = "numbers of another unit, scale or origin, or of a picture of another size";
        Err(format!("expected markers in or near the picture of {w} x {h}, found {} of {n} points far from it: {why}", n - near))
    }
}

impl Whole for IoReadMarkers {
    fn check(&self) -> Vec<Problem> {
        let mut problems = Vec::new();
        if let Err(message) = is_json(&self.path.at(0)) {
            problems.push(Problem { input: "path", message });
        }
        if self.path.is_sequence() {
            problems.push(Problem { input: "path", message: "expected one file, found a frame number as #### in its path".to_owned() });
        }
        if let Some((_, twice)) = self.names.iter().enumerate().find(|(k, n)| self.names[..*k].contains(n)) {
            problems.push(Problem { input: "names", message: format!("expected each marker once, found `{twice}` again") });
        }
        problems
    }

    fn run(self, cx: &Context) -> Result<IoReadMarkersOutputs, NodeError> {
        let path = self.path.at(0);
        let text = text(&path)?;
        let read = if is_json(&path).map_err(NodeError::input)? { read_json_markers } else { read_csv_markers };
        let tracks = read(&text).map_err(|e| refused(&path, e))?;
        let chosen = self.chosen(&tracks).map_err(|e| refused(&path, e))?;
        let pixels = self.pixels(tracks.size).map_err(|e| refused(&path, e))?;
        self.expect_units(&tracks, &chosen, &pixels).map_err(|e| refused(&path, e))?;
        if let Some(&none) = chosen.iter().find(|&&t| tracks.tracks[t].values().all(Option::is_none)) {
            return Err(refused(&path, format!("expected `{}` to be seen at one frame at least, found none", tracks.names[none])));
        }
        let fill = match self.missing {
            Unmarked::Hold => Fill::Hold,
            Unmarked::Interpolate => Fill::Straight,
            Unmarked::Error | Unmarked::Nan => Fill::Nothing,
        };
        let names: Vec<String> = chosen.iter().map(|&t| tracks.names[t].clone()).collect();
        let mut frames = Vec::with_capacity(cx.clock.len());
        for frame in cx.clock.first..=cx.clock.last {
            cx.check()?;
            let own = frame - self.offset;
            let untold = |t: &&usize| !tracks.tracks[**t].contains_key(&own);
            if let (Unmarked::Error, Some(&t)) = (self.missing, chosen.iter().find(untold)) {
                let error = refused(&path, format!("expected a place of `{}` at frame {own}, found none", tracks.names[t]));
                return Err(error.help("`missing: hold`, `interpolate` or `nan`"));
            }
            let points = chosen.iter().map(|&t| pixels(at(&tracks.tracks[t], own, fill))).collect();
            frames.push(Markers2 { points, names: names.clone() });
        }
        Ok(IoReadMarkersOutputs { markers: Stream(frames) })
    }
}
