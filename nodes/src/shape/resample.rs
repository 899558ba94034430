//! `shape.resample`: contours with one number of points in one order over time.
//!
//! **Method** see [`crate::algo::resample`]: equal steps between anchors; or from where the contour before begins, stretched so that
//! corners meet corners.
//!
//! **Source** Bregler, Loeb, Chuang, Deshpande 2002, section 3.2 (contours of the same points); Sakoe, Chiba 1978.
//!
//! **Fails when** a contour has no points. Without anchors, parts that appear or vanish between drawings pull their neighbours along.
//!
//! **Cost** O(count²) a frame. Frames that follow the one before run in order.
//!
//! ```ron
//! "points": (type: "shape.resample", shape: "@outline", count: 200),
//! ```

use pegbar_engine::node::{Context, In, NodeError, Recurrent};
use pegbar_engine::{Node, Outputs, Setting};

use crate::algo::resample::{Following, Line, ResampleError, between_anchors, following};
use crate::data::Shape;

/// Which contour the points of a contour without anchors follow.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Setting)]
pub(crate) enum Follow {
    /// That of the frame before: right for drawings that change a lot in the end.
    Previous,
    /// That of the clock's first frame: nothing adds up over time.
    First,
    /// None: each begins at its own first point.
    None,
}

/// Contours with one number of points in one order over time.
#[derive(Node)]
#[node(
    id = "shape.resample",
    version = 1,
    kind = recurrent,
    outputs = ShapeResampleOutputs,
    source = "Bregler, Loeb, Chuang, Deshpande 2002, section 3.2; Sakoe, Chiba 1978",
    example = "\"points\": (type: \"shape.resample\", shape: \"@outline\", count: 200)"
)]
pub(crate) struct ShapeResample {
    /// The contours.
    shape: In<Shape>,
    /// Points of each. Fewer lose corners, more cost time.
    #[input(default = 200, range = 2..=10000)]
    count: u32,
    /// Labelled places, the same ones in the same order at every frame: the contour begins at the first, and as many points lie between
    /// each two.
    anchors: Option<In<Shape>>,
    /// A contour that every frame follows, in as many points as are asked for: for sets of keys that are to match a sequence.
    like: Option<In<Shape>>,
    /// What a contour without anchors follows.
    #[input(default = previous)]
    follow: Follow,
    /// How far steps are stretched so that corners meet corners. 0 keeps equal steps, 1 is usual, large follows at any price.
    #[input(default = 1.0, range = 0.0..=1000.0)]
    elastic: f64,
    /// Whether the drawing may have turned by any angle against the contour that it follows: for keys that are drawn in other poses, and
    /// for spins. Else it is matched as it stands, which is surer.
    #[input(default = false)]
    turned: bool,
}

/// The contours.
#[derive(Outputs)]
pub(crate) struct ShapeResampleOutputs {
    /// As many points at every frame, each the same place of the drawing; open or closed as it was.
    shape: Shape,
}

fn refused(error: ResampleError) -> NodeError {
    NodeError::input(error.to_string())
}

impl ShapeResample {
    fn points(&self, followed: Option<&Shape>) -> Result<Vec<[f64; 2]>, ResampleError> {
        let how = Following { elastic: self.elastic, turned: self.turned };
        let (line, count) = (Line::new(&self.shape.points, self.shape.closed)?, self.count as usize);
        if let Some(anchors) = &self.anchors {
            return between_anchors(&line, &anchors.points, count);
        }
        if let Some(like) = &self.like {
            let like = Line::new(&like.points, like.closed)?.steps(count, 0.0);
            return Ok(following(&line, &like, how));
        }
        Ok(match followed {
            Some(shape) if self.follow != Follow::None => following(&line, &shape.points, how),
            _ => line.steps(count, 0.0),
        })
    }

    fn is_alone(&self) -> bool {
        self.anchors.is_some() || self.like.is_some() || self.follow == Follow::None
    }
}

impl Recurrent for ShapeResample {
    type State = Shape;

    fn run(self, state: Option<&Shape>, _cx: &Context) -> Result<(ShapeResampleOutputs, Shape), NodeError> {
        let shape = Shape { points: self.points(state).map_err(refused)?, closed: self.shape.closed };
        Ok((ShapeResampleOutputs { shape: shape.clone() }, shape))
    }

    fn previous(&self, cx: &Context) -> Option<i64> {
        let from = if self.follow == Follow::First { cx.clock.first } else { cx.frame - 1 };
        (cx.frame > cx.clock.first && !self.is_alone()).then_some(from)
    }
}
