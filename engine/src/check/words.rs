//! What inputs take and what stands there, in words for people.

use crate::clock::Clock;
use crate::node::{InputSchema, InputType};
use crate::setting::SettingError;

pub(super) fn with_article(name: &str) -> String {
    let article = if name.starts_with(['A', 'E', 'I', 'O', 'U']) { "an" } else { "a" };
    format!("{article} {name}")
}

/// Type, unit and range of an input, for messages.
pub(super) fn describe_input(input: &InputSchema) -> String {
    let mut out = match &input.ty {
        InputType::Any => "a reference to any value".to_owned(),
        InputType::Value(name) => match input.literal {
            Some(form) => format!("a reference to {}, or {form}", with_article(name)),
            None => format!("a reference to {}", with_article(name)),
        },
        InputType::Setting { name, wire } => match wire {
            Some(wire) => format!("{name}, or a reference to {}", with_article(wire)),
            None => name.clone(),
        },
    };
    if let Some(unit) = input.unit {
        out.push_str(&format!(", in {unit}"));
    }
    if let Some((least, greatest)) = input.range {
        out.push_str(&format!(", {}", describe_range(least, greatest)));
    }
    out
}

pub(super) fn describe_range(least: f64, greatest: f64) -> String {
    match (least.is_finite(), greatest.is_finite()) {
        (true, true) => format!("from {least} to {greatest}"),
        (true, false) => format!("at least {least}"),
        (false, true) => format!("at most {greatest}"),
        (false, false) => "any number".to_owned(),
    }
}

pub(super) fn describe_clock(clock: &Clock) -> String {
    let (count, of) = clock.fps;
    let rate = if of == 1 { count.to_string() } else { format!("{count}/{of}") };
    format!("`{}` ({} to {} at {rate} fps)", clock.name, clock.first, clock.last)
}

/// The words of RON, and those of a graph file's author.
const WORDS: [(&str, &str); 8] = [
    ("float", "a number"),
    ("integer", "a whole number"),
    ("string", "a text in quotes"),
    ("boolean", "true or false"),
    ("list", "a list as [...]"),
    ("tuple", "values in round brackets"),
    ("name", "a bare word"),
    ("character", "a character"),
];

/// Why a literal is refused: what was expected in plain words, and what was found as it is written.
pub(super) fn refusal(error: &SettingError, text: &str) -> String {
    let Some((expected, found)) = error.message.strip_prefix("expected ").and_then(|m| m.split_once(", found ")) else {
        return error.message.clone();
    };
    let word = |w: &str| WORDS.iter().find(|(ron, _)| *ron == w).map(|(_, plain)| (*plain).to_owned());
    let part = text.get(error.span.clone()).map(str::trim).filter(|p| !p.is_empty() && p.chars().count() <= 40 && !p.contains('\n'));
    let found = match (word(found), part) {
        (Some(_), Some(part)) => part.to_owned(),
        (Some(plain), None) => plain,
        (None, _) => found.to_owned(),
    };
    format!("expected {}, found {found}", word(expected).unwrap_or_else(|| expected.to_owned()))
}
