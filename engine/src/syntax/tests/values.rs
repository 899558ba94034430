//! Values are read as Rust types, and errors point at the part that is wrong.

use std::collections::BTreeMap;

use serde::Deserialize;
use serde::de::DeserializeOwned;

use crate::syntax::{Tree, parse_value};

#[derive(Debug, Deserialize, PartialEq)]
#[serde(rename_all = "snake_case")]
enum Mode {
    Over,
    Under,
    Mix { amount: f64 },
}

#[derive(Debug, Deserialize, PartialEq)]
struct Degrees(f64);

#[derive(Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
struct Settings {
    size: (u32, u32),
    mode: Mode,
    angle: Option<Degrees>,
    #[serde(default)]
    names: Vec<String>,
}

/// Reads `(v: <text>)`'s field.
fn read<T: DeserializeOwned>(text: &str) -> Result<T, (String, String)> {
    let source = format!("Gräph(\n  v: {text},\n)");
    let tree = Tree::parse(source.as_str());
    assert_eq!(tree.errors(), []);
    let node = tree.value().unwrap().field("v").unwrap().value().unwrap();
    parse_value(node).map_err(|error| (source[error.span.range()].to_owned(), error.message))
}

#[track_caller]
fn assert_refused<T: DeserializeOwned + std::fmt::Debug>(text: &str, place: &str, message: &str) {
    assert_eq!(read::<T>(text).map(|value| format!("{value:?}")), Err((place.to_owned(), message.to_owned())), "{text}");
}

#[test]
fn good_values_are_read() {
    assert_eq!(read::<f64>("2"), Ok(2.0));
    assert_eq!(read::<Option<u32>>("5"), Ok(Some(5)));
    assert_eq!(read::<Option<u32>>("Some(5)"), Ok(Some(5)));
    assert_eq!(read::<Option<u32>>("None"), Ok(None));
    assert_eq!(read::<Vec<[f32; 2]>>("[(1, 2.5), /* c */ (3, 4)]"), Ok(vec![[1.0, 2.5], [3.0, 4.0]]));
    assert_eq!(read::<BTreeMap<String, bool>>("{\"a\": true}"), Ok(BTreeMap::from([("a".to_owned(), true)])));
    let settings = Settings { size: (1, 2), mode: Mode::Mix { amount: 0.5 }, angle: Some(Degrees(90.0)), names: Vec::new() };
    assert_eq!(read::<Settings>("(size: (1, 2), mode: mix(amount: 0.5), angle: 90)"), Ok(settings));
}

#[test]
fn wrong_types_are_told() {
    assert_refused::<f64>("\"é9\"", "\"é9\"", "expected float, found string");
    assert_refused::<u32>("\"9\"", "\"9\"", "expected integer, found string");
    assert_refused::<u32>("1.5", "1.5", "expected integer, found float");
    assert_refused::<u32>("(1, 2)", "(1, 2)", "expected integer, found tuple");
    assert_refused::<u32>("1..5", "1..5", "expected number, found range");
    assert_refused::<u8>("300", "300", "expected integer within the range of its type, found `300`");
    assert_refused::<u32>("-1", "-1", "expected integer within the range of its type, found `-1`");
    assert_refused::<String>("5", "5", "expected string, found integer");
    assert_refused::<String>("['a']", "['a']", "expected string, found list");
    assert_refused::<bool>("1", "1", "expected boolean, found integer");
    assert_refused::<Vec<u32>>("(1, 2)", "(1, 2)", "expected list, found tuple");
    assert_refused::<(u32, u32)>("[1, 2]", "[1, 2]", "expected values in round brackets, found list");
    assert_refused::<BTreeMap<String, u32>>("[1]", "[1]", "expected map, found list");
    assert_refused::<Mode>("\"over\"", "\"over\"", "expected name, found string");
}

#[test]
fn errors_inside_a_value_point_at_the_part() {
    assert_refused::<Vec<u32>>("[1, /* c */ \"two\", 3]", "\"two\"", "expected integer, found string");
    assert_refused::<Vec<u32>>("[\n 1,\n 2.5,\n]", "2.5", "expected integer, found float");
    assert_refused::<Vec<(f64, f64)>>("[(1, 2), (3, x)]", "x", "expected float, found name");
    assert_refused::<(f64, f64)>("(1, 2, 3)", "(1, 2, 3)", "expected fewer values, found 3 values");
    assert_refused::<(f64, f64)>("(1,)", "(1,)", "expected tuple of size 2, found 1 elements");
    assert_refused::<Settings>("(size: (1, 2), mode: overr)", "overr", "unknown name `overr`");
    assert_refused::<Settings>("(size: (1, 2), mood: over)", "mood", "unknown field `mood`");
    assert_refused::<Settings>("(size: (1, 2),\n)", "(size: (1, 2),\n)", "missing field `mode`");
    assert_refused::<Settings>("(size: (1, 2), size: (1, 2))", "size", "field `size` is given twice");
    assert_refused::<Settings>("(size: (1, 2), mode: mix(amount: \"x\"))", "\"x\"", "expected float, found string");
    assert_refused::<std::num::NonZeroU8>("0", "0", "expected nonzero u8, found unsigned integer `0`");
}

#[test]
fn help_tells_how_to_write_it() {
    let help = |text: &str| {
        let source = format!("({text})");
        let tree = Tree::parse(source.as_str());
        parse_value::<Settings>(tree.value().unwrap()).unwrap_err().help.unwrap_or_default()
    };
    assert_eq!(help("size: (1, 2), mode: ovre"), "did you mean `over`?");
    assert_eq!(help("size: (1, 2), mode: \"over\""), "write it without quotes: `over`");
    assert_eq!(help("size: (1, 2), mode: over, nmaes: []"), "did you mean `names`?");
    assert_eq!(help("size: (1, 2), mode: over, names: [a]"), "write it in quotes: `\"a\"`");
    assert_eq!(help("size: [1, 2], mode: over"), "write it in round brackets: `(...)`");
    assert_eq!(help("size: (1, \"2\"), mode: over"), "write it without quotes: `2`");
}

#[test]
fn nothing_makes_reading_panic() {
    for text in ["\"", "(", "", "é", "(a: 1", "1 2", "[1, 2"] {
        assert!(crate::syntax::parse_slice::<Settings>(text, crate::syntax::Extensions::empty()).is_err());
        let tree = Tree::parse(text);
        for node in tree.root().descendants() {
            let span = node.span();
            if let Err(error) = parse_value::<Settings>(node) {
                assert!(error.span.start >= span.start && error.span.end <= span.end, "{error:?} in {node:?}");
            }
        }
    }
}
