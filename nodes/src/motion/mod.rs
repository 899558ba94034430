//! Motion set by hand, and filters on motion: affine motions, weights, curves, contours.

mod anticipate;
mod exaggerate;
mod follow_through;
#[cfg(test)]
mod graph_tests;
mod keys;
mod pin;
mod smooth;
pub(crate) mod timing;
mod warp;

pub(crate) use anticipate::MotionAnticipate;
pub(crate) use exaggerate::MotionExaggerate;
pub(crate) use follow_through::MotionFollowThrough;
pub(crate) use keys::MotionKeys;
pub(crate) use pin::MotionPin;
pub(crate) use smooth::MotionSmooth;
pub(crate) use warp::MotionWarp;

use std::sync::Arc;

use pegbar_engine::Outputs;
use pegbar_engine::node::{AnySequence, AnyStream, Context, NodeError};
use pegbar_engine::value::{Curve, TimeMap, Value, ValueRef, Vector, downcast};

use crate::algo::motion::{Group, Holds, Kind, Split, still_point};
use crate::algo::raster::Affine;
use crate::data::{Affine2, Shape, Weights};

/// The motion, filtered.
#[derive(Outputs)]
pub(crate) struct Moved {
    /// Of the same type as the motion that came in.
    motion: AnyStream,
}

/// A motion in memory: curves, and how they become values again.
pub(crate) struct Motion {
    values: Vec<ValueRef>,
    pub(crate) groups: Vec<Group>,
    form: Form,
}

enum Form {
    Affine(Split),
    Weights,
    Curve,
    Vector,
    Shape(bool),
}

fn refused(error: impl std::fmt::Display) -> NodeError {
    NodeError::input(error.to_string())
}

fn all<T: Value>(values: &[ValueRef]) -> Result<Vec<Arc<T>>, NodeError> {
    values
        .iter()
        .map(|v| downcast(v.clone()).ok_or_else(|| refused(format!("expected {} throughout, found {}", T::NAME, v.type_name()))))
        .collect()
}

/// Curves of rows of as many finite numbers each.
fn curves(rows: &[Vec<f64>], first: i64) -> Result<Vec<Vec<f64>>, NodeError> {
    let count = rows.first().map_or(0, Vec::len);
    for (k, row) in rows.iter().enumerate() {
        let frame = first + k as i64;
        if row.len() != count {
            return Err(refused(format!("frame {frame}: expected {count} numbers as at the first frame, found {}", row.len())));
        }
        if !row.iter().all(|v| v.is_finite()) {
            return Err(refused(format!("frame {frame}: expected finite numbers, found NaN or infinity")));
        }
    }
    Ok((0..count).map(|i| rows.iter().map(|r| r[i]).collect()).collect())
}

/// A fill for what a node of the wrong type was given.
const TYPES: &str = "expected a motion of Affine2, Weights, Curve, Vector or Shape";

impl Motion {
    /// Reads a motion; an affine one is taken apart about `pivot`, by itself about the point that moves least.
    pub(crate) fn read(values: &AnySequence, pivot: Option<[f64; 2]>, cx: &Context) -> Result<Self, NodeError> {
        let values = values.gather()?;
        let first = cx.clock.first;
        let kind = values.first().ok_or_else(|| refused("expected a motion of at least one frame, found none"))?.type_name();
        let group = |kind, curves| vec![Group { kind, curves }];
        let rows = |r: Vec<Vec<f64>>| curves(&r, first);
        let (groups, form) = if kind == Affine2::NAME {
            let maps: Vec<Affine> = all::<Affine2>(&values)?.iter().map(|a| Affine::from(&**a)).collect();
            let (split, groups) = Split::new(&maps, pivot.unwrap_or_else(|| still_point(&maps))).map_err(refused)?;
            (groups, Form::Affine(split))
        } else if kind == Weights::NAME {
            let all = all::<Weights>(&values)?;
            (group(Kind::Weights, rows(all.iter().map(|w| w.weights.clone()).collect())?), Form::Weights)
        } else if kind == Curve::NAME {
            let all = all::<Curve>(&values)?;
            (group(Kind::Values, rows(all.iter().map(|c| vec![c.value]).collect())?), Form::Curve)
        } else if kind == Vector::NAME {
            let all = all::<Vector>(&values)?;
            (group(Kind::Values, rows(all.iter().map(|v| v.values.clone()).collect())?), Form::Vector)
        } else if kind == Shape::NAME {
            let all = all::<Shape>(&values)?;
            let points = rows(all.iter().map(|s| s.points.as_flattened().to_vec()).collect())?;
            (group(Kind::Translation, points), Form::Shape(all[0].closed))
        } else {
            return Err(refused(format!("{TYPES}, found {kind}")));
        };
        Ok(Self { values, groups, form })
    }

    /// Number of frames.
    pub(crate) fn len(&self) -> usize {
        self.values.len()
    }

    /// The values of the curves as they are now; as they came in where `same`.
    pub(crate) fn write(self, same: bool) -> Moved {
        if same {
            return Moved { motion: AnyStream(self.values) };
        }
        let curves: Vec<&Vec<f64>> = self.groups.iter().flat_map(|g| &g.curves).collect();
        let row = |k: usize| curves.iter().map(|c| c[k]).collect::<Vec<f64>>();
        let n = self.values.len();
        let motion: Vec<ValueRef> = match &self.form {
            Form::Affine(split) => split.join(&self.groups).into_iter().map(|m| Arc::new(Affine2::from(m)) as ValueRef).collect(),
            Form::Weights => (0..n).map(|k| Arc::new(Weights { weights: row(k) }) as ValueRef).collect(),
            Form::Curve => (0..n).map(|k| Arc::new(Curve { value: row(k)[0] }) as ValueRef).collect(),
            Form::Vector => (0..n).map(|k| Arc::new(Vector { values: row(k) }) as ValueRef).collect(),
            Form::Shape(closed) => {
                let shape = |k| Shape { points: row(k).as_chunks().0.to_vec(), closed: *closed };
                (0..n).map(|k| Arc::new(shape(k)) as ValueRef).collect()
            }
        };
        Moved { motion: AnyStream(motion) }
    }
}

/// The drawings of a motion of `n` frames.
pub(crate) fn drawings(holds: Option<&TimeMap>, n: usize) -> Result<Holds, NodeError> {
    match holds {
        None => Ok(Holds::none(n)),
        Some(map) if map.source_frames.len() == n => Ok(Holds::of(&map.source_frames)),
        Some(map) => Err(refused(format!("holds: expected {n} frames as the motion has, found {}", map.source_frames.len()))),
    }
}

/// Filters every group of curves drawing by drawing.
pub(crate) fn filter(motion: &mut Motion, holds: &Holds, mut by: impl FnMut(Kind, &[Vec<f64>], &[f64]) -> Vec<Vec<f64>>) {
    for group in &mut motion.groups {
        let drawn: Vec<Vec<f64>> = group.curves.iter().map(|c| holds.drawings(c)).collect();
        group.curves = by(group.kind, &drawn, &holds.times).iter().map(|c| holds.frames(c)).collect();
    }
}
