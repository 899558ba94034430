//! `eval.rms`: how far one stream is from another.
//!
//! **Method** root mean square over frames of each coordinate's difference; their mean and maximum, and that of each frame over its coordinates.
//!
//! **Source** Jain, Sheikh, Hodgins 2009, section 4, figure 10 (each coordinate) and table 1 (mean and maximum).
//!
//! Markers that have names go together by them; those that only one stream has are left out. `plot.bars` draws the tables of markers and coordinates.
//!
//! **Fails when** the streams are of different types, have different numbers of numbers, no marker in common, or others from frame to frame.
//!
//! **Cost** O(frames · numbers).
//!
//! ```ron
//! "error": (type: "eval.rms", values: "@lifted.markers", truth: "@truth", root: "pelvis"),
//! ```

use pegbar_engine::array::NdArray;
use pegbar_engine::node::{AnySequence, Context, NodeError, Stream, Whole};
use pegbar_engine::value::{Curve, ValueRef, Vector, downcast};
use pegbar_engine::{Node, Outputs};

use crate::basis::numbers;
use crate::data::{Markers2, Markers3, Table};

/// How far one stream is from another.
#[derive(Node)]
#[node(
    id = "eval.rms",
    version = 2,
    kind = whole,
    outputs = EvalRmsOutputs,
    source = "Jain, Sheikh, Hodgins 2009, section 4, fig. 10 and table 1",
    example = "\"error\": (type: \"eval.rms\", values: \"@lifted.markers\", truth: \"@truth\")"
)]
pub(crate) struct EvalRms {
    /// What is measured: markers, vectors, curves, poses, or anything else that is made of numbers.
    values: AnySequence,
    /// What it should be.
    truth: AnySequence,
    /// The marker that is brought to the same place in both at every frame. Places count as they are where it is left out.
    #[input(default = None)]
    root: Option<String>,
}

/// The errors, in the unit of the values.
#[derive(Outputs)]
pub(crate) struct EvalRmsOutputs {
    /// Of each number, in the order of the values: x, y, z of each marker in turn.
    rms: Vector,
    /// Mean of these.
    mean: Curve,
    /// Their maximum.
    max: Curve,
    /// Of each frame, over its numbers.
    frames: Stream<Curve>,
    /// How many pairs of numbers were left out, as one of them is NaN: not seen.
    missing: Curve,
    /// Of each marker, by name: rms, mean and max of its distance over the frames in which both see it. Of each number where there are no markers.
    markers: Table,
    /// Of each number, as `left_wrist x`: rms, mean and max of its absolute difference.
    coordinates: Table,
}

/// A frame.
struct Row {
    numbers: Vec<f64>,
    /// Of markers.
    names: Vec<String>,
    /// Numbers of a marker; 1 where there are none.
    dims: usize,
}

/// The numbers of the markers that both have, in the order of the first, and their names; all numbers where markers have no names.
fn common(a: Row, b: Row) -> (Vec<f64>, Vec<f64>, Vec<String>) {
    if a.names == b.names || a.names.is_empty() || b.names.is_empty() {
        let names = if a.names.is_empty() { b.names } else { a.names };
        return (a.numbers, b.numbers, names);
    }
    let at = |name: &String| b.names.iter().position(|n| n == name);
    let pairs: Vec<(usize, usize)> = a.names.iter().enumerate().filter_map(|(i, n)| at(n).map(|j| (i, j))).collect();
    let pick = |row: &Row, k: usize| row.numbers[k * row.dims..(k + 1) * row.dims].to_vec();
    let names = pairs.iter().map(|p| a.names[p.0].clone()).collect();
    (pairs.iter().flat_map(|p| pick(&a, p.0)).collect(), pairs.iter().flat_map(|p| pick(&b, p.1)).collect(), names)
}

/// What was found of one marker, or one number.
#[derive(Clone, Default)]
struct Found {
    squares: f64,
    sum: f64,
    max: f64,
    count: usize,
}

impl Found {
    /// Adds the square of a distance; NaN counts nothing.
    fn add(&mut self, square: f64) {
        if !square.is_nan() {
            self.squares += square;
            self.sum += square.sqrt();
            self.max = self.max.max(square.sqrt());
            self.count += 1;
        }
    }

    /// RMS, mean and max; NaN where it was never seen.
    fn row(&self) -> [f64; 3] {
        let n = self.count as f64;
        if self.count > 0 { [(self.squares / n).sqrt(), self.sum / n, self.max] } else { [f64::NAN; 3] }
    }
}

fn table(found: &[Found], rows: Vec<String>) -> Result<Table, NodeError> {
    let values = NdArray::new([found.len(), 3], found.iter().flat_map(Found::row).collect());
    let values = values.ok_or_else(|| NodeError::internal("a table of another size"))?;
    Ok(Table { values, rows, columns: ["rms", "mean", "max"].map(str::to_owned).to_vec() })
}

/// A frame's numbers, those of markers from the root.
fn row(value: &ValueRef, root: Option<&str>) -> Result<Row, NodeError> {
    let from = |names: &[String], points: &dyn Fn(usize) -> Vec<f64>| {
        let Some(root) = root else { return Ok(Vec::new()) };
        let at = names.iter().position(|n| n == root);
        at.map(points).ok_or_else(|| NodeError::input(format!("root: expected a marker, found {root:?}, which is none of them")))
    };
    let less = |all: Vec<f64>, origin: Vec<f64>| match origin.len() {
        0 => all,
        d => all.chunks_exact(d).flat_map(|p| p.iter().zip(&origin).map(|(a, b)| a - b).collect::<Vec<_>>()).collect(),
    };
    if let Some(m) = downcast::<Markers3>(value.clone()) {
        let numbers = less(m.points.concat(), from(&m.names, &|k| m.points[k].to_vec())?);
        return Ok(Row { numbers, names: m.names.clone(), dims: 3 });
    }
    if let Some(m) = downcast::<Markers2>(value.clone()) {
        let numbers = less(m.points.concat(), from(&m.names, &|k| m.points[k].to_vec())?);
        return Ok(Row { numbers, names: m.names.clone(), dims: 2 });
    }
    if root.is_some() {
        return Err(NodeError::input(format!("root: expected markers, found {} values", value.type_name())));
    }
    Ok(Row { numbers: numbers(value), names: Vec::new(), dims: 1 })
}

impl Whole for EvalRms {
    fn run(self, cx: &Context) -> Result<EvalRmsOutputs, NodeError> {
        let n = self.values.len().max(self.truth.len());
        let (mut each, mut whole): (Vec<Found>, Vec<Found>) = Default::default();
        let (mut names, mut dims) = (Vec::new(), 1);
        let mut frames = Vec::with_capacity(n);
        for k in 0..n {
            cx.check()?;
            // A single value stands for every frame.
            let get = |s: &AnySequence| s.get(if s.len() == 1 { 0 } else { k });
            let (value, truth) = (get(&self.values)?, get(&self.truth)?);
            let located = |message: String| NodeError::input(format!("frame {}: {message}", cx.clock.first + k as i64));
            if value.type_name() != truth.type_name() {
                return Err(located(format!("expected two streams of one type, found {} and {}", value.type_name(), truth.type_name())));
            }
            let read =
                |v: &ValueRef| row(v, self.root.as_deref()).map_err(|e| NodeError { message: located(e.message.clone()).message, ..e });
            let (value, truth) = (read(&value)?, read(&truth)?);
            dims = value.dims;
            let (a, b, called) = common(value, truth);
            let expected = if each.is_empty() { b.len() } else { each.len() };
            if a.len() != expected || b.len() != expected {
                return Err(located(format!("expected {expected} numbers in both, found {} and {}", a.len(), b.len())));
            }
            if a.is_empty() {
                return Err(located("expected markers of the same names in both, found none".to_owned()));
            }
            if each.is_empty() {
                names = called;
            } else if names != called {
                return Err(located("expected markers of the same names as in the frames before, in their order, found others".to_owned()));
            }
            each.resize(expected, Found::default());
            whole.resize(expected / dims, Found::default());
            let squares: Vec<f64> = a.iter().zip(&b).map(|(a, b)| (a - b).powi(2)).collect();
            each.iter_mut().zip(&squares).for_each(|(f, s)| f.add(*s));
            whole.iter_mut().zip(squares.chunks_exact(dims)).for_each(|(f, s)| f.add(s.iter().sum()));
            let seen: Vec<f64> = squares.into_iter().filter(|s| !s.is_nan()).collect();
            frames.push(Curve { value: (seen.iter().sum::<f64>() / seen.len().max(1) as f64).sqrt() });
        }
        while let (true, Some(last)) = (frames.len() < cx.clock.len(), frames.last()) {
            frames.push(last.clone());
        }
        let rms: Vec<f64> = each.iter().map(|f| f.row()[0]).collect();
        let known: Vec<f64> = rms.iter().copied().filter(|v| !v.is_nan()).collect();
        let mean = known.iter().sum::<f64>() / known.len().max(1) as f64;
        let missing = each.iter().map(|f| n - f.count).sum::<usize>();
        let coordinates =
            names.iter().flat_map(|name| ["x", "y", "z"][..dims.min(3)].iter().map(move |axis| format!("{name} {axis}"))).collect();
        let curve = |value: f64| Curve { value };
        Ok(EvalRmsOutputs {
            mean: curve(mean),
            max: curve(known.iter().copied().fold(0.0, f64::max)),
            frames: Stream(frames),
            missing: curve(missing as f64),
            markers: table(&whole, names.clone())?,
            coordinates: table(&each, coordinates)?,
            rms: Vector { values: rms },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::counted::{clock, counted};
    use pegbar_engine::node::Cancel;

    fn markers(x: f64) -> Markers3 {
        Markers3 { points: vec![[x, 0.0, 1.0], [x + 3.0, 4.0, f64::NAN]], names: vec!["a".to_owned(), "b".to_owned()] }
    }

    fn run(values: AnySequence, truth: AnySequence, root: Option<&str>) -> Result<EvalRmsOutputs, NodeError> {
        let clock = clock(4);
        let node = EvalRms { values, truth, root: root.map(str::to_owned) };
        node.run(&Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &Cancel::default() })
    }

    #[test]
    fn errors_are_those_of_each_coordinate() {
        let found = run(counted(4, |k| markers([3.0, 4.0, -3.0, -4.0][k])).0, counted(4, |_| markers(0.0)).0, None).unwrap();
        let side = 12.5_f64.sqrt();
        assert_eq!(found.rms.values[..5], [side, 0.0, 0.0, side, 0.0]);
        assert!(found.rms.values[5].is_nan());
        assert_eq!((found.mean.value, found.max.value, found.missing.value), (2.0 * side / 5.0, side, 4.0));
        assert_eq!(found.frames.0[1].value, (32.0_f64 / 5.0).sqrt());
    }

    #[test]
    fn tables_tell_of_each_marker_and_each_coordinate() {
        let found = run(counted(4, |k| markers([3.0, 4.0, -3.0, -4.0][k])).0, counted(4, |_| markers(0.0)).0, None).unwrap();
        assert_eq!(
            (found.markers.rows, found.markers.columns),
            (vec!["a".to_owned(), "b".to_owned()], ["rms", "mean", "max"].map(str::to_owned).to_vec())
        );
        // The second is never seen as a whole: its z is not known.
        assert_eq!(found.markers.values.data()[..3], [12.5_f64.sqrt(), 3.5, 4.0]);
        assert!(found.markers.values.data()[3..].iter().all(|v| v.is_nan()));
        assert_eq!(found.coordinates.rows, ["a x", "a y", "a z", "b x", "b y", "b z"]);
        assert_eq!(found.coordinates.column("max").unwrap()[..5], [4.0, 0.0, 0.0, 4.0, 0.0]);
        let both = |k: usize| Markers2 { points: vec![[3.0 * k as f64, 4.0 * k as f64]], names: Vec::new() };
        let found = run(counted(4, both).0, counted(1, move |_| both(0)).0, None).unwrap();
        assert_eq!((found.markers.rows.len(), found.markers.values.data()), (0, &[87.5_f64.sqrt(), 7.5, 15.0][..]));
        assert_eq!(found.coordinates.column("mean").unwrap(), [4.5, 6.0]);
        let plain = run(counted(4, |k| Vector { values: vec![k as f64] }).0, counted(4, |_| Vector { values: vec![1.0] }).0, None).unwrap();
        assert_eq!((plain.markers.column("max").unwrap(), plain.markers.rows.len()), (vec![2.0], 0));
    }

    #[test]
    fn markers_do_not_change_their_names() {
        let other = |k: usize| Markers2 { points: vec![[0.0; 2]; 2], names: [["a", "b"], ["b", "a"]][k / 2].map(str::to_owned).to_vec() };
        let error = run(counted(4, other).0, counted(4, other).0, None).err().unwrap();
        assert_eq!(error.message, "frame 3: expected markers of the same names as in the frames before, in their order, found others");
    }

    #[test]
    fn figures_are_brought_together_by_their_roots() {
        let found = run(counted(4, |k| markers(k as f64)).0, counted(1, |_| markers(0.0)).0, Some("a")).unwrap();
        assert_eq!((found.max.value, found.rms.values.len()), (0.0, 6));
        let error = run(counted(4, |_| markers(0.0)).0, counted(4, |_| markers(0.0)).0, Some("c")).err().unwrap();
        assert_eq!(error.message, "frame 1: root: expected a marker, found \"c\", which is none of them");
    }

    #[test]
    fn markers_go_together_by_name() {
        let other = |names: &[&str], points: Vec<[f64; 3]>| Markers3 { points, names: names.iter().map(|n| (*n).to_owned()).collect() };
        let truth = move |_| other(&["tail", "b", "a"], vec![[9.0; 3], [3.0, 4.0, 0.0], [0.0, 0.0, 2.0]]);
        let found = run(counted(4, |_| markers(0.0)).0, counted(4, truth).0, None).unwrap();
        assert_eq!(found.rms.values[..5], [0.0, 0.0, 1.0, 0.0, 0.0]);
        assert_eq!(found.missing.value, 4.0);
        let none = run(counted(4, |_| markers(0.0)).0, counted(4, move |_| other(&["tail"], vec![[9.0; 3]])).0, None).err().unwrap();
        assert_eq!(none.message, "frame 1: expected markers of the same names in both, found none");
    }

    #[test]
    fn streams_that_are_not_alike_are_refused() {
        let vector = |n: usize| Vector { values: vec![0.0; n] };
        let error = run(counted(4, move |_| vector(2)).0, counted(4, |_| markers(0.0)).0, None).err().unwrap();
        assert_eq!(error.message, "frame 1: expected two streams of one type, found Vector and Markers3");
        let error = run(counted(4, move |k| vector(2 + k / 2)).0, counted(4, move |_| vector(2)).0, None).err().unwrap();
        assert!(error.message.starts_with("frame 3: expected 2 numbers in both, found 3 and 2"), "{}", error.message);
    }
}
