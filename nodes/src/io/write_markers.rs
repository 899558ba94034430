//! `io.write_markers`: marked points to CSV or JSON, as `io.read_markers` reads them.
//!
//! Numbers are written in the fewest digits that read back to the same bits; a marker that is not seen has none. The file is written beside its place and
//! renamed.
//!
//! **Source**: RFC 4180; RFC 8259. **Fails when** frames have other markers than the first, or a number is infinite. **Cost**: O(bytes).
//!
//! ```ron
//! Graph(pegbar: 1, frames: (first: 1, last: 24, fps: 24), nodes: {
//!     "marked": (type: "io.read_markers", path: "walk.csv"),
//!     "out": (type: "io.write_markers", markers: "@marked", path: "$out/walk.json", size: (1280, 720)),
//! })
//! ```

use pegbar_engine::Node;
use pegbar_engine::node::{Context, Fault, NodeError, Problem, Sequence, Whole};
use pegbar_engine::setting::OutputPath;

use super::file;
use crate::algo::markers::table::{write_csv_markers, write_json_markers};
use crate::data::Markers2;

/// Writes marked points: `.csv` or `.json`.
#[derive(Node)]
#[node(
    id = "io.write_markers",
    version = 1,
    kind = whole,
    source = "RFC 4180; RFC 8259",
    example = "\"out\": (type: \"io.write_markers\", markers: \"@marked\", path: \"$out/walk.json\", size: (1280, 720))"
)]
pub(crate) struct IoWriteMarkers {
    /// The markers.
    markers: Sequence<Markers2>,
    /// The file, inside the output folder, ending in .csv or .json.
    path: OutputPath,
    /// Width and height of the picture, which JSON tells.
    #[input(default = None, range = 1..=65536, unit = "px")]
    size: Option<[i64; 2]>,
}

impl Whole for IoWriteMarkers {
    fn check(&self) -> Vec<Problem> {
        let path = self.path.at(0);
        let mut problems = Vec::new();
        if !path.extension().is_some_and(|e| e.eq_ignore_ascii_case("csv") || e.eq_ignore_ascii_case("json")) {
            let found = path.extension().unwrap_or_default().to_string_lossy().into_owned();
            problems.push(Problem { input: "path", message: format!("expected a path ending in .csv or .json, found {found:?}") });
        }
        if self.path.is_sequence() {
            problems.push(Problem { input: "path", message: "expected one file, found a frame number as #### in its path".to_owned() });
        }
        problems
    }

    fn run(self, cx: &Context) -> Result<(), NodeError> {
        let first = self.markers.clock().map_or(cx.clock.first, |c| c.first);
        let (mut names, mut frames) = (Vec::new(), Vec::new());
        for k in 0..self.markers.len() {
            cx.check()?;
            let (frame, markers) = (first + k as i64, self.markers.get(k)?);
            let refused = |message: &str| NodeError::input(format!("markers at frame {frame}: {message}"));
            if k == 0 {
                let numbered = || (0..markers.points.len()).map(|m| format!("marker_{m}")).collect();
                names = if markers.names.is_empty() { numbered() } else { markers.names.clone() };
            }
            if markers.points.len() != names.len() || !markers.names.is_empty() && markers.names != names {
                return Err(refused("expected the markers of the first frame, found others"));
            }
            if markers.points.as_flattened().iter().any(|v| v.is_infinite()) {
                return Err(refused("expected finite places, or NaN, found infinity"));
            }
            frames.push((frame, markers.points.clone()));
        }
        let path = self.path.at(0);
        if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("csv")) {
            return file::write(&path, Fault::Io, |out| write_csv_markers(&names, &frames, out));
        }
        let size = self.size.map(|s| s.map(|n| n as f64));
        let text = write_json_markers(size, &names, &frames).map_err(|e| NodeError::internal(e.to_string()))?;
        file::write(&path, Fault::Io, |out| std::io::Write::write_all(out, text.as_bytes()))
    }
}
