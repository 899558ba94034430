//! Limbs and chains by the names of their markers.

use pegbar_engine::node::NodeError;
use pegbar_engine::setting::{Setting, SettingError};
use pegbar_engine::syntax::{Extensions, parse_slice};
use serde::de::DeserializeOwned;

fn parse<T: DeserializeOwned>(text: &str) -> Result<T, SettingError> {
    parse_slice(text, Extensions::empty()).map_err(|e| SettingError { span: e.span.range(), message: e.message, choices: Vec::new() })
}

/// Limbs, each by the markers where it begins and ends.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Limbs(pub(crate) Vec<(String, String)>);

impl Setting for Limbs {
    fn type_name() -> String {
        "list of limbs (\"parent\", \"child\")".to_owned()
    }
    fn parse(text: &str) -> Result<Self, SettingError> {
        parse(text).map(Self)
    }
}

impl Limbs {
    /// Positions among markers of these names.
    pub(crate) fn find(&self, names: &[String], input: &str) -> Result<Vec<[usize; 2]>, NodeError> {
        self.0.iter().map(|(from, to)| Ok([position(names, from, input)?, position(names, to, input)?])).collect()
    }
}

/// Chains of markers, each from its root outwards.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Chains(pub(crate) Vec<Vec<String>>);

impl Setting for Chains {
    fn type_name() -> String {
        "list of chains [\"root\", \"next\", \"last\"]".to_owned()
    }
    fn parse(text: &str) -> Result<Self, SettingError> {
        parse(text).map(Self)
    }
}

/// Position of a marker among others.
pub(crate) fn position(names: &[String], name: &str, input: &str) -> Result<usize, NodeError> {
    names.iter().position(|n| n == name).ok_or_else(|| {
        let there = names.iter().take(40).map(|n| format!("{n:?}")).collect::<Vec<_>>().join(", ");
        let there = if there.is_empty() { "the markers have no names".to_owned() } else { format!("the markers are {there}") };
        NodeError::input(format!("{input}: expected a marker {name:?}, found none")).help(there)
    })
}
