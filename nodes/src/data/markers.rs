//! Markers: named points that are followed over time.

use pegbar_engine::Value;

/// Named points of a picture: the joints of a drawing, or of a skeleton as a camera sees them.
#[derive(Clone, Debug, Default, PartialEq, Value)]
#[value(check = "validate")]
pub struct Markers2 {
    /// Where each marker is: pixels, origin at the top left corner of the format; NaN where it is not seen.
    #[value(shape = "[n, 2]")]
    pub points: Vec<[f64; 2]>,
    /// Name of each marker, or none at all.
    #[value(text)]
    pub names: Vec<String>,
}

/// Named points of the world: the joints of a skeleton.
#[derive(Clone, Debug, Default, PartialEq, Value)]
#[value(check = "validate")]
pub struct Markers3 {
    /// Where each marker is: metres, Y up; NaN where it is not known.
    #[value(shape = "[n, 3]")]
    pub points: Vec<[f64; 3]>,
    /// Name of each marker, or none at all.
    #[value(text)]
    pub names: Vec<String>,
}

macro_rules! markers {
    ($type:ident) => {
        impl $type {
            /// Position of the marker `name`.
            pub fn find(&self, name: &str) -> Option<usize> {
                self.names.iter().position(|n| n == name)
            }

            /// What keeps the parts from being markers.
            ///
            /// # Errors
            /// Where there are names, but not one for each marker, or two of one name.
            pub fn validate(&self) -> Result<(), String> {
                named(&self.names, self.points.len())
            }
        }
    };
}

markers!(Markers2);
markers!(Markers3);

fn named(names: &[String], n: usize) -> Result<(), String> {
    if !names.is_empty() && names.len() != n {
        return Err(format!("expected a name for each of {n} markers or none, found {}", names.len()));
    }
    let mut sorted: Vec<&String> = names.iter().collect();
    sorted.sort_unstable();
    let twice = sorted.windows(2).find(|w| w[0] == w[1]);
    twice.map_or(Ok(()), |w| Err(format!("expected one marker of each name, found two `{}`", w[0])))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn markers_have_a_name_each_or_none() {
        let markers = |n: usize, names: &[&str]| {
            Markers2 { points: vec![[0.0; 2]; n], names: names.iter().map(|n| (*n).to_owned()).collect() }.validate()
        };
        assert_eq!(markers(2, &[]), Ok(()));
        assert_eq!(markers(2, &["hand", "foot"]), Ok(()));
        assert_eq!(markers(2, &["hand"]), Err("expected a name for each of 2 markers or none, found 1".to_owned()));
        assert_eq!(markers(3, &["b", "a", "b"]), Err("expected one marker of each name, found two `b`".to_owned()));
    }
}
