//! `drawing.merge`: parts of a character, or several characters, as one drawing.
//!
//! **Method** every part is moved by its own motion and then by those of the parts that carry it, as an arm by the body; widths of lines stay as they
//! are drawn. Paths then come in the order of their depth, so that parts which lie in front of and behind each other go together again.
//!
//! **Source** Bregler, Loeb, Chuang, Deshpande 2002, section 3.1.4 (sub-parts). **Fails when** there are more motions or parents than drawings, a parent
//! is none of them, parts carry each other in a ring, or a motion or depth is not finite.
//!
//! **Cost** O(points).
//!
//! ```ron
//! "frog": (type: "drawing.merge", drawings: ["@body", "@arm"], motions: ["@body_motion", "@arm_motion"], parents: [-1, 0]),
//! ```

use pegbar_engine::node::{Context, Fault, In, List, NodeError, PerFrame};
use pegbar_engine::{Node, Outputs, Setting};

use crate::algo::raster::{Affine, apply, compose, identity};
use crate::data::{Affine2, Drawing};

/// What is in front of what.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum Order {
    /// Paths by their depth in the drawing that they were read from: for parts of one drawing.
    Depth,
    /// All paths of a drawing in front of those of the drawings before it.
    Stack,
}

/// Parts of a character, or several characters, as one drawing.
#[derive(Node)]
#[node(
    id = "drawing.merge",
    version = 1,
    outputs = DrawingMergeOutputs,
    source = "Bregler, Loeb, Chuang, Deshpande 2002, section 3.1.4",
    example = "\"frog\": (type: \"drawing.merge\", drawings: [\"@body\", \"@arm\"], motions: [\"@body_motion\", \"@arm_motion\"], parents: [-1, 0])"
)]
pub(crate) struct DrawingMerge {
    /// The parts.
    drawings: List<In<Drawing>>,
    /// Where each goes, in the order of the parts: frame from reference, pixels; for a part that another carries, as seen from there. Parts
    /// without one stay where they are.
    motions: List<Option<In<Affine2>>>,
    /// For each part the one that carries it, by its position from 0, or -1 for none. None for parts that are left out.
    #[input(default = [], range = -1..=1000000)]
    parents: Vec<i64>,
    /// What is in front of what.
    #[input(default = depth)]
    order: Order,
}

/// The drawing.
#[derive(Outputs)]
pub(crate) struct DrawingMergeOutputs {
    /// It, in the format of the first part.
    drawing: Drawing,
}

impl DrawingMerge {
    /// Where each part goes by itself.
    fn own(&self) -> Result<Vec<Affine>, NodeError> {
        let n = self.drawings.0.len();
        let refuse = |what: &str, found: usize| {
            let message = format!("expected at most {n} {what}, one for each drawing, found {found}");
            Err(NodeError::new(Fault::Parameters, message))
        };
        if self.motions.0.len() > n {
            return refuse("motions", self.motions.0.len());
        }
        if self.parents.len() > n {
            return refuse("parents", self.parents.len());
        }
        let motion = |i: usize| match self.motions.0.get(i).and_then(Option::as_ref) {
            None => Ok(identity()),
            Some(motion) => {
                let map = Affine::from(&**motion);
                let error = || NodeError::input(format!("motion {i}: expected a finite affine map, found NaN or infinity"));
                if map.iter().all(|v| v.is_finite()) { Ok(map) } else { Err(error()) }
            }
        };
        (0..n).map(motion).collect()
    }

    /// The part that carries a part.
    fn parent(&self, part: usize) -> Result<Option<usize>, NodeError> {
        let n = self.drawings.0.len();
        match self.parents.get(part).copied().unwrap_or(-1) {
            -1 => Ok(None),
            p if p >= 0 && (p as usize) < n => Ok(Some(p as usize)),
            p => Err(NodeError::new(Fault::Parameters, format!("parent of part {part}: expected -1 or a part below {n}, found {p}"))),
        }
    }

    /// The motion of a part after those of all that carry it.
    fn carried(&self, own: &[Affine], part: usize) -> Result<Affine, NodeError> {
        let mut map = own[part];
        let mut at = part;
        for _ in 0..own.len() {
            let Some(parent) = self.parent(at)? else { return Ok(map) };
            map = compose(&own[parent], &map);
            at = parent;
        }
        let message = format!("expected parts that are carried in the end by one that nothing carries, found a ring at part {part}");
        Err(NodeError::new(Fault::Parameters, message).help("set the parent of one of them to -1"))
    }
}

impl PerFrame for DrawingMerge {
    fn run(self, _cx: &Context) -> Result<DrawingMergeOutputs, NodeError> {
        let own = self.own()?;
        let mut merged = Drawing { size: self.drawings.0.first().map_or([0.0; 2], |d| d.size), ..Drawing::default() };
        for (i, part) in self.drawings.0.iter().enumerate() {
            let map = self.carried(&own, i)?;
            let mut moved = Drawing::clone(part);
            moved.points.iter_mut().for_each(|p| *p = apply(&map, (*p).into()).into());
            merged.append(&moved);
        }
        if let Some(path) = merged.depth.iter().position(|d| d.is_nan()) {
            return Err(NodeError::input(format!("{}: expected a depth, found NaN", merged.name(path))));
        }
        if self.order == Order::Depth {
            let mut paths: Vec<usize> = (0..merged.paths.len()).collect();
            // Of paths as deep the one of the later part is in front: the sort keeps their order.
            paths.sort_by(|&a, &b| merged.depth[a].total_cmp(&merged.depth[b]));
            merged = merged.picked(&paths);
        }
        Ok(DrawingMergeOutputs { drawing: merged })
    }
}

#[cfg(test)]
mod tests {
    use pegbar_engine::node::Cancel;

    use super::*;
    use crate::counted::clock;

    /// A drawing of dots at these places and depths.
    fn dots(places: &[([f64; 2], f64)]) -> In<Drawing> {
        let n = places.len();
        In::new(Drawing {
            points: places.iter().map(|p| p.0).collect(),
            contours: vec![1; n],
            closed: vec![0; n],
            paths: vec![1; n],
            fill: vec![[0.0; 4]; n],
            stroke: vec![[0.0; 4]; n],
            width: vec![0.0; n],
            rule: vec![0; n],
            depth: places.iter().map(|p| p.1).collect(),
            size: [8.0, 6.0],
            names: places.iter().map(|p| format!("{}", p.1)).collect(),
            groups: Vec::new(),
        })
    }

    fn motion(matrix: [[f64; 3]; 2]) -> Option<In<Affine2>> {
        Some(In::new(Affine2 { matrix }))
    }

    fn run(motions: Vec<Option<In<Affine2>>>, parents: &[i64], order: Order) -> Result<Drawing, String> {
        let drawings = List(vec![dots(&[([1.0, 0.0], 0.0), ([2.0, 0.0], 2.0)]), dots(&[([3.0, 0.0], 1.0)])]);
        let node = DrawingMerge { drawings, motions: List(motions), parents: parents.to_vec(), order };
        let clock = clock(1);
        let cx = Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &Cancel::default() };
        node.run(&cx).map(|out| out.drawing).map_err(|e| e.message)
    }

    const RIGHT: [[f64; 3]; 2] = [[1.0, 0.0, 10.0], [0.0, 1.0, 0.0]];
    /// A quarter turn about the origin.
    const TURN: [[f64; 3]; 2] = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0]];

    #[test]
    fn parts_come_by_depth_or_one_over_the_other() {
        let merged = run(vec![], &[], Order::Depth).unwrap();
        assert_eq!((merged.depth, merged.names.concat(), merged.size), (vec![0.0, 1.0, 2.0], "012".to_owned(), [8.0, 6.0]));
        assert_eq!(merged.points, [[1.0, 0.0], [3.0, 0.0], [2.0, 0.0]]);
        assert_eq!(run(vec![], &[], Order::Stack).unwrap().depth, [0.0, 2.0, 1.0]);
    }

    #[test]
    fn a_part_goes_where_its_own_motion_and_then_that_of_its_parent_take_it() {
        let moved = |parents: &[i64]| run(vec![motion(TURN), motion(RIGHT)], parents, Order::Stack).unwrap().points;
        assert_eq!(moved(&[]), [[0.0, 1.0], [0.0, 2.0], [13.0, 0.0]]);
        assert_eq!(moved(&[-1, 0]), [[0.0, 1.0], [0.0, 2.0], [0.0, 13.0]]);
        assert_eq!(moved(&[1, -1])[0], [10.0, 1.0]);
        assert_eq!(run(vec![None, motion(RIGHT)], &[], Order::Stack).unwrap().points[2], [13.0, 0.0]);
    }

    #[test]
    fn wrong_trees_are_said() {
        let error = |motions, parents: &[i64]| run(motions, parents, Order::Depth).unwrap_err();
        assert_eq!(
            error(vec![], &[1, 0]),
            "expected parts that are carried in the end by one that nothing carries, found a ring at part 0"
        );
        assert_eq!(error(vec![], &[2]), "parent of part 0: expected -1 or a part below 2, found 2");
        assert_eq!(error(vec![None, None, None], &[]), "expected at most 2 motions, one for each drawing, found 3");
        let nan = motion([[f64::NAN, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        assert_eq!(error(vec![nan], &[]), "motion 0: expected a finite affine map, found NaN or infinity");
    }
}
