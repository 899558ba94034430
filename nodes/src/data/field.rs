//! Fields over the vertices of a mesh, and what they are made of.

use pegbar_engine::Value;
use pegbar_engine::setting::SettingError;
use pegbar_engine::syntax::{Extensions, parse_slice};
use serde::Deserialize;

/// Where points of a mesh are drawn.
#[derive(Clone, Debug, Default, PartialEq, Value)]
#[value(
    check = "validate",
    literal = "parse",
    form = "a list of pairs (vertex: 12, point: (120.5, 80.0)) or (edge: (12, 13), share: 0.25, point: (120.5, 80.0), weight: 1.0)"
)]
pub struct Correspondences {
    /// The mesh edge that each point lies on: two vertices, the same one twice for a vertex.
    #[value(shape = "[n, 2]")]
    pub edges: Vec<[u32; 2]>,
    /// How far along from the first to the second, 0 to 1.
    #[value(shape = "[n]")]
    pub shares: Vec<f64>,
    /// Where each point is drawn: pixels, origin at the top left corner of the format.
    #[value(shape = "[n, 2]")]
    pub points: Vec<[f64; 2]>,
    /// How much each pair counts where others want something else, 0 or more. None at all stands for 1 each.
    #[value(shape = "[n]", optional)]
    pub weights: Vec<f64>,
}

impl Correspondences {
    /// Number of pairs.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// True without a pair.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// How much a pair counts.
    pub fn weight(&self, idx: usize) -> f64 {
        self.weights.get(idx).copied().unwrap_or(1.0)
    }

    /// What keeps the parts from being correspondences.
    ///
    /// # Errors
    /// Where their numbers differ.
    pub fn validate(&self) -> Result<(), String> {
        let (n, e, s, w) = (self.points.len(), self.edges.len(), self.shares.len(), self.weights.len());
        if e == n && s == n && (w == n || w == 0) {
            return Ok(());
        }
        Err(format!("expected an edge, a share and a weight for each of {n} points, or no weights, found {e}, {s} and {w}"))
    }
}

/// One pair as it is written.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Pair {
    #[serde(default)]
    vertex: Option<u32>,
    #[serde(default)]
    edge: Option<[u32; 2]>,
    #[serde(default)]
    share: f64,
    point: [f64; 2],
    #[serde(default)]
    weight: Option<f64>,
}

fn parse(text: &str) -> Result<Correspondences, SettingError> {
    let pairs: Vec<Pair> = parse_slice(text, Extensions::IMPLICIT_SOME).map_err(|e| SettingError {
        span: e.span.range(),
        message: e.message,
        choices: Vec::new(),
    })?;
    let mut found = Correspondences::default();
    for (at, pair) in pairs.iter().enumerate() {
        let edge = match (pair.vertex, pair.edge) {
            (Some(v), None) => [v, v],
            (None, Some(edge)) => edge,
            _ => return Err(SettingError::whole(text, format!("pair {at}: expected either a vertex or an edge"))),
        };
        found.edges.push(edge);
        found.shares.push(pair.share);
        found.points.push(pair.point);
        found.weights.push(pair.weight.unwrap_or(1.0));
    }
    Ok(found)
}

/// How far each vertex of a mesh is moved in the picture.
#[derive(Clone, Debug, Default, PartialEq, Value)]
pub struct Field2 {
    /// For each vertex, pixels to the right and down.
    #[value(shape = "[v, 2]")]
    pub vectors: Vec<[f64; 2]>,
}

/// How far each vertex of a mesh is moved in the world.
#[derive(Clone, Debug, Default, PartialEq, Value)]
pub struct Field3 {
    /// For each vertex, metres, Y up.
    #[value(shape = "[v, 3]")]
    pub vectors: Vec<[f64; 3]>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_are_written_by_vertex_or_by_edge() {
        let found = parse("[(vertex: 3, point: (1.5, 2)), (edge: (4, 7), share: 0.25, point: (3, 4), weight: 0.5)]").unwrap();
        let truth = Correspondences {
            edges: vec![[3, 3], [4, 7]],
            shares: vec![0.0, 0.25],
            points: vec![[1.5, 2.0], [3.0, 4.0]],
            weights: vec![1.0, 0.5],
        };
        assert_eq!(found, truth);
        assert_eq!((found.validate(), found.len(), found.weight(1)), (Ok(()), 2, 0.5));
        assert_eq!(parse("[(point: (1, 2))]").unwrap_err().message, "pair 0: expected either a vertex or an edge");
        let few = Correspondences { shares: vec![0.0], ..truth };
        let error = "expected an edge, a share and a weight for each of 2 points, or no weights, found 2, 1 and 2";
        assert_eq!(few.validate(), Err(error.to_owned()));
    }
}
