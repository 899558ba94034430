//! `correspond.curves`: which point of a mesh's lines is drawn where.
//!
//! **Method** anchors are connected along the lines of the mesh, going over from one to the next where it goes behind, and along the curves of the drawing;
//! between two anchors points are paired by their share of the length, or corner by corner ([`crate::algo::correspond`]).
//!
//! **Source** Li, Gleicher, Xu, Shum, *Stylizing Motion with Drawings*, 2003, section 3.2, figure 5.
//!
//! An anchor stands on the drawn curve nearest to it, and on others that meet it there. Of several ways on the mesh the one whose shape is most like the drawn
//! section's counts; ways go over from line to line where those cross in the picture, or come near each other.
//!
//! **Fails when** an anchor of the render lies away from all lines that are seen, or no way along the lines leads from anchor to anchor. Anchors override all
//! else: one whose drawn place lies on no curve is a pair by itself. Where a line runs through a triangle, between two of its edges, only its ends are paired.
//!
//! **Cost** O(anchors · n log n) with n points of the mesh's lines.
//!
//! ```ron
//! "pairs": (type: "correspond.curves", silhouette: "@lines.curves", drawn: "@leg.curves", anchors: [(render: (210.0, 138.0), drawn: (212.0, 140.0)), (vertex: 1840, drawn: (198.0, 330.0))]),
//! ```

use pegbar_engine::node::{Context, In, List, NodeError, PerFrame, Problem};
use pegbar_engine::value::Curve;
use pegbar_engine::{Node, Outputs};

use super::anchors::{Anchor, Anchors};
use crate::algo::correspond::{self, MeshLines, Missing, Options, Pairing, Spot, Strand, nearest_spot, pair};
use crate::algo::mesh_lines::between;
use crate::data::{Correspondences, Curves, Markers2};
use crate::render::within;

/// Which point of a mesh's lines is drawn where.
#[derive(Node)]
#[node(
    id = "correspond.curves",
    version = 2,
    outputs = CorrespondCurvesOutputs,
    source = "Li, Gleicher, Xu, Shum 2003, section 3.2",
    example = "\"pairs\": (type: \"correspond.curves\", silhouette: \"@lines.curves\", drawn: \"@leg.curves\", anchors: [(render: (210.0, 138.0), drawn: (212.0, 140.0)), (vertex: 1840, drawn: (198.0, 330.0))])"
)]
pub(crate) struct CorrespondCurves {
    /// The lines of the mesh, one value or a list: `mesh.silhouette`'s, and your own of `mesh.features`.
    pub(crate) silhouette: List<In<Curves>>,
    /// The curves of the drawing, one or a list.
    pub(crate) drawn: List<In<Curves>>,
    /// What belongs together: `render`, a pixel near a line of the mesh, or `vertex`, its number; and `drawn`, a pixel of the drawing.
    #[input(default = [])]
    pub(crate) anchors: Anchors,
    /// More anchors, as pixels of the render; those of the drawing have the same names.
    pub(crate) render_markers: Option<In<Markers2>>,
    /// Where those are drawn.
    pub(crate) drawn_markers: Option<In<Markers2>>,
    /// How points between two anchors are paired.
    #[input(default = length)]
    pub(crate) pairing: Pairing,
    /// Least distance between two pairs on the mesh's side. 0 pairs every point where a line crosses an edge.
    #[input(default = 0.0, range = 0.0..=65536.0, unit = "px")]
    pub(crate) spacing: f64,
    /// Most distance between two pairs on the mesh's side where a line runs along an edge of the mesh. 0 pairs nothing between a line's points.
    #[input(default = 4.0, range = 0.0..=65536.0, unit = "px")]
    pub(crate) step: f64,
    /// How far an anchor may be from a line of the mesh, or from a drawn curve, to stand on it.
    #[input(default = 12.0, range = 0.0..=65536.0, unit = "px")]
    pub(crate) snap: f64,
    /// Widest gap between two lines of the mesh that the outline goes across where one goes behind the other.
    #[input(default = 6.0, range = 0.0..=65536.0, unit = "px")]
    pub(crate) bridge: f64,
    /// How much an anchor counts; other pairs count 1.
    #[input(default = 4.0, range = 0.0..=1000000.0)]
    pub(crate) anchor_weight: f64,
    /// What becomes of a section of the drawing that has no way along the mesh's lines.
    #[input(default = error)]
    pub(crate) missing: Missing,
}

/// The pairs.
#[derive(Outputs)]
pub(crate) struct CorrespondCurvesOutputs {
    /// The anchors first, then what lies between them.
    pub(crate) correspondences: Correspondences,
    /// Number of pairs.
    pub(crate) count: Curve,
    /// Number of sections between anchors that were paired.
    pub(crate) sections: Curve,
    /// Number of sections without a way, which were left out.
    pub(crate) skipped: Curve,
}

/// The curves of several values as strands, each numbered on from the last.
fn strands(curves: &Curves) -> Vec<Strand<'_>> {
    curves.iter().map(|c| Strand { first: c.first, points: c.points, closed: c.closed }).collect()
}

impl CorrespondCurves {
    fn all_anchors(&self) -> Result<Vec<Anchor>, NodeError> {
        let mut all = self.anchors.0.clone();
        let pairs = match (&self.render_markers, &self.drawn_markers) {
            (None, None) => return Ok(all),
            (Some(render), Some(drawn)) => (render, drawn),
            _ => return Err(NodeError::input("expected both `render_markers` and `drawn_markers` or neither, found one")),
        };
        let (render, drawn) = pairs;
        for (i, p) in render.points.iter().enumerate().filter(|(_, p)| p.iter().all(|v| !v.is_nan())) {
            let at = match render.names.get(i) {
                Some(name) => drawn.find(name),
                None => (i < drawn.points.len()).then_some(i),
            };
            match at.and_then(|k| drawn.points.get(k)).filter(|q| q.iter().all(|v| !v.is_nan())) {
                Some(q) => all.push(Anchor { render: Some(*p), vertex: None, drawn: *q }),
                None => {
                    let name = render.names.get(i).cloned().unwrap_or_else(|| i.to_string());
                    let names = drawn.names.join(", ");
                    return Err(NodeError::input(format!("render_markers: expected `{name}` among the drawn markers, found {names}")));
                }
            }
        }
        Ok(all)
    }

    /// The mesh's side of an anchor: an edge with a share, and the place on the lines that it is at.
    fn on_mesh(&self, lines: &MeshLines<'_>, number: usize, anchor: &Anchor) -> Result<([u32; 2], f64, Option<Spot>), NodeError> {
        if let Some(v) = anchor.vertex {
            // The point of an edge of that vertex that is next to it.
            let near = |i: usize| {
                let ([a, b], s) = (lines.edges[i], lines.shares[i]);
                let off = if a == v { s } else { 1.0 - s };
                (a == v || b == v).then_some((i, if a == b { 0.0 } else { off }))
            };
            let best = (0..lines.edges.len()).filter_map(near).min_by(|a, b| a.1.total_cmp(&b.1));
            return Ok(([v, v], 0.0, best.map(|b| Spot::point(b.0))));
        }
        let Some(at) = anchor.render else {
            return Err(NodeError::input(format!("anchor {number}: expected either `render` or `vertex`, found neither")));
        };
        let ([x, y], snap) = (at, self.snap);
        match nearest_spot(lines, at) {
            Some((spot, off)) if off <= snap => {
                let place = |i: usize| (lines.edges[i], lines.shares[i]);
                let (a, b) = (place(spot.from), place(spot.to));
                // Within a triangle there is no edge to stand on: the nearer end of that stretch does.
                let nearer = if spot.share < 0.5 { (a, spot.from) } else { (b, spot.to) };
                let (place, spot) = between(a, b, spot.share).map_or((nearer.0, Spot::point(nearer.1)), |p| (p, spot));
                Ok((place.0, place.1, Some(spot)))
            }
            Some((_, off)) => {
                let message = format!(
                    "anchor {number} at ({x}, {y}): expected a line of the mesh within {snap} px, found the nearest {off:.1} px away"
                );
                Err(NodeError::input(message)
                    .help("`vertex` puts an anchor anywhere on the mesh; render.correspondences shows where lines are"))
            }
            None => Err(NodeError::input(format!("anchor {number} at ({x}, {y}): expected a line of the mesh that is seen, found none"))),
        }
    }

    /// All lines of the mesh.
    fn lines(&self) -> Result<Curves, NodeError> {
        let mut lines = Curves::default();
        for (i, own) in self.silhouette.0.iter().enumerate() {
            own.validate().map_err(|e| NodeError::input(format!("silhouette {i}: {e}")))?;
            if own.edges.is_empty() && !own.points.is_empty() {
                return Err(
                    NodeError::input("silhouette: expected lines of a mesh, found drawn curves").help("they come from mesh.silhouette")
                );
            }
            lines.append(own);
        }
        Ok(lines)
    }

    fn check_numbers(&self) -> Result<(), NodeError> {
        within("spacing", self.spacing, 0.0, 65536.0)?;
        within("step", self.step, 0.0, 65536.0)?;
        within("snap", self.snap, 0.0, 65536.0)?;
        within("bridge", self.bridge, 0.0, 65536.0)?;
        within("anchor_weight", self.anchor_weight, 0.0, 1e6)?;
        for (i, curves) in self.drawn.0.iter().enumerate() {
            curves.validate().map_err(|e| NodeError::input(format!("drawn {i}: {e}")))?;
            if let Some(k) = curves.points.iter().position(|p| p.iter().any(|v| !v.is_finite())) {
                return Err(NodeError::input(format!("drawn {i}: expected finite points, found {:?} at point {k}", curves.points[k])));
            }
        }
        Ok(())
    }
}

impl PerFrame for CorrespondCurves {
    fn run(self, _cx: &Context) -> Result<CorrespondCurvesOutputs, NodeError> {
        self.check_numbers()?;
        let anchors = self.all_anchors()?;
        let lines = self.lines()?;
        let own = strands(&lines);
        let mesh = MeshLines { strands: &own, visible: &lines.visible, edges: &lines.edges, shares: &lines.shares };
        let mut out = Correspondences::default();
        let mut push = |edge: [u32; 2], share: f64, point: [f64; 2], weight: f64| {
            out.edges.push(edge);
            out.shares.push(share);
            out.points.push(point);
            out.weights.push(weight);
        };
        let mut ends = Vec::with_capacity(anchors.len());
        for (i, anchor) in anchors.iter().enumerate() {
            if anchor.drawn.iter().any(|v| !v.is_finite()) {
                return Err(NodeError::input(format!(
                    "anchor {}: expected a finite place in the drawing, found {:?}",
                    i + 1,
                    anchor.drawn
                )));
            }
            let (edge, share, spot) = self.on_mesh(&mesh, i + 1, anchor)?;
            push(edge, share, anchor.drawn, self.anchor_weight);
            ends.push(correspond::Anchor { spot, drawn: anchor.drawn });
        }
        let options = Options {
            pairing: self.pairing,
            snap: self.snap,
            bridge: self.bridge,
            spacing: self.spacing,
            step: self.step,
            missing: self.missing,
        };
        let drawn: Vec<Strand<'_>> = self.drawn.0.iter().flat_map(|c| strands(c)).collect();
        let found = pair(&mesh, &drawn, &ends, &options).map_err(|e| {
            NodeError::input(e.to_string())
                .help("set an anchor between them, a wider `bridge` or `missing: skip`; render.correspondences shows the lines")
        })?;
        for p in &found.pairs {
            push(p.edge, p.share, p.drawn, 1.0);
        }
        let count = Curve { value: out.points.len() as f64 };
        let [sections, skipped] = [found.sections, found.skipped].map(|n| Curve { value: n as f64 });
        Ok(CorrespondCurvesOutputs { count, correspondences: out, sections, skipped })
    }

    fn check(&self) -> Vec<Problem> {
        self.anchors.problems().into_iter().map(|message| Problem { input: "anchors", message }).collect()
    }
}
