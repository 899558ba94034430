//! Settings of plugins' nodes: the engine's own types by name, and what of them goes over the border.

use std::sync::Arc;

use super::manifest::intern;
use crate::node::{Input, Literal, ParseLiteral};
use crate::setting::{Choice, ClockName, FileUse, InputPath, InputPaths, Missing, OutputPath, Setting, SettingError, choose};
use crate::value::ValueRef;

/// A type of settings.
pub(super) struct SettingType {
    /// Its name for people.
    pub(super) name: String,
    /// Reads the literal.
    pub(super) parse: ParseLiteral,
    /// What files it names.
    pub(super) files: FileUse,
}

/// A setting as it goes over the border.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SettingData {
    /// As RON, relative paths resolved.
    pub ron: String,
    /// The text of a text, a path or a word.
    pub text: String,
    /// The numbers in it.
    pub numbers: Vec<f64>,
    /// The same as whole numbers.
    pub wholes: Vec<i64>,
}

impl SettingData {
    fn text(text: String) -> Self {
        Self { ron: ron::to_string(&text).unwrap_or_default(), text, ..Self::default() }
    }

    /// The setting that a literal is; `None` where it is none.
    pub(super) fn of(literal: &Literal) -> Option<Self> {
        if let Some(data) = literal.downcast_ref::<Self>() {
            return Some(data.clone());
        }
        let read = one::<InputPath>(literal).map(|p| Self::text(p.pattern()));
        let written = || one::<OutputPath>(literal).map(|p| Self::text(p.pattern()));
        let clock = || one::<ClockName>(literal).map(|c| Self::text(c.0));
        let several = || {
            let paths: Vec<String> = one::<InputPaths>(literal)?.0.iter().map(InputPath::pattern).collect();
            Some(Self { ron: ron::to_string(&paths).ok()?, text: paths.join("\n"), ..Self::default() })
        };
        let missing = || {
            let word = match one::<Missing>(literal)? {
                Missing::Error => "error",
                Missing::Hold => "hold",
                Missing::Nearest => "nearest",
            };
            Some(Self { ron: word.to_owned(), text: word.to_owned(), ..Self::default() })
        };
        let none = || {
            let is_none = is_none::<InputPath>(literal) || is_none::<OutputPath>(literal) || is_none::<ClockName>(literal);
            is_none.then(|| Self { ron: "None".to_owned(), ..Self::default() })
        };
        read.or_else(written).or_else(several).or_else(clock).or_else(missing).or_else(none)
    }
}

fn one<T: Clone + 'static>(literal: &Literal) -> Option<T> {
    literal.downcast_ref::<T>().cloned().or_else(|| literal.downcast_ref::<Option<T>>().cloned().flatten())
}

fn is_none<T: 'static>(literal: &Literal) -> bool {
    literal.downcast_ref::<Option<T>>().is_some_and(Option::is_none)
}

impl SettingType {
    /// The type of a name.
    pub(super) fn of(name: &str, choices: &[(String, String)], optional: bool) -> Result<Self, String> {
        if name == Missing::type_name() {
            return Ok(engines::<Missing>(optional));
        }
        if !choices.is_empty() {
            return Ok(word(choices, optional));
        }
        let types: [fn(bool) -> Self; 21] = [
            plain::<f64>,
            plain::<i64>,
            plain::<bool>,
            plain::<String>,
            plain::<[f64; 2]>,
            plain::<[f64; 3]>,
            plain::<[f64; 4]>,
            plain::<[i64; 2]>,
            plain::<[i64; 4]>,
            plain::<Vec<f64>>,
            plain::<Vec<i64>>,
            plain::<Vec<[f64; 2]>>,
            plain::<Vec<[f64; 3]>>,
            plain::<Vec<[f64; 4]>>,
            plain::<Vec<Vec<f64>>>,
            plain::<Vec<String>>,
            engines::<InputPath>,
            engines::<InputPaths>,
            engines::<OutputPath>,
            engines::<ClockName>,
            engines::<Missing>,
        ];
        let mut types = types.iter().map(|make| make(optional));
        types.find(|ty| ty.name == name).ok_or_else(|| format!("expected a type of settings as `number`, found `{name}`"))
    }
}

/// A type that the engine itself looks into: paths and clocks.
fn engines<T: Setting>(optional: bool) -> SettingType {
    let parse: ParseLiteral = if optional { Arc::new(<Option<T> as Input>::parse) } else { Arc::new(<T as Input>::parse) };
    SettingType { name: T::type_name(), parse, files: T::FILES }
}

/// A type that the plugin alone looks into.
fn plain<T: Setting>(optional: bool) -> SettingType {
    let parse = move |text: &str| {
        if optional && text.trim() == "None" {
            return Ok((SettingData { ron: "None".to_owned(), ..SettingData::default() }, Vec::new()));
        }
        let value = T::parse(text)?;
        let any: &dyn std::any::Any = &value;
        let ranged = value.numbers();
        let numbers = any.downcast_ref::<bool>().map_or_else(|| ranged.clone(), |&b| vec![f64::from(u8::from(b))]);
        // Above 2^53 a float does not hold every whole number.
        let exact = any.downcast_ref::<i64>().map(|&n| vec![n]);
        let wholes = exact.unwrap_or_else(|| numbers.iter().map(|&n| n as i64).collect());
        let text_of = any.downcast_ref::<String>().cloned().unwrap_or_default();
        Ok((SettingData { ron: text.trim().to_owned(), text: text_of, numbers, wholes }, ranged))
    };
    let parse: ParseLiteral = Arc::new(move |text, _| parse(text).map(|(data, ranged)| (Arc::new(data) as Literal, ranged)));
    SettingType { name: T::type_name(), parse, files: FileUse::None }
}

/// One of several words.
fn word(choices: &[(String, String)], optional: bool) -> SettingType {
    let choices: Vec<Choice> = choices.iter().map(|(name, doc)| Choice { name: intern(name), doc: intern(doc) }).collect();
    let name = choices.iter().map(|c| c.name).collect::<Vec<_>>().join(" | ");
    let parse = move |text: &str| {
        if optional && text.trim() == "None" {
            return Ok(SettingData { ron: "None".to_owned(), ..SettingData::default() });
        }
        let place = choose(text, &choices)?;
        let word = choices[place].name.to_owned();
        Ok::<_, SettingError>(SettingData { ron: word.clone(), text: word, numbers: vec![place as f64], wholes: vec![place as i64] })
    };
    let parse: ParseLiteral = Arc::new(move |text, _| parse(text).map(|data| (Arc::new(data) as Literal, Vec::new())));
    SettingType { name, parse, files: FileUse::None }
}

/// Reads a value that is written in the graph file, where its type can be.
pub(super) fn value_literal(name: &'static str) -> ParseLiteral {
    Arc::new(move |text, place| match place.types.get(name).and_then(|ty| ty.literal.as_ref()) {
        Some(syntax) => (syntax.parse)(text).map(|value: ValueRef| (Arc::new(value) as Literal, Vec::new())),
        None => Err(SettingError::whole(text, format!("expected a reference to {name}, found a literal"))),
    })
}
