//! Literals to stand at settings while a node is tried.

use crate::node::InputSchema;

/// A literal for a setting that has no default.
pub(super) fn usual(name: &str, input: &InputSchema) -> Option<String> {
    let (least, most) = input.range.unwrap_or((f64::MIN, f64::MAX));
    let number = format!("{:?}", 0.5_f64.clamp(least, most));
    let whole = format!("{}", 1.0_f64.clamp(least, most) as i64);
    let repeated = |one: &str, n: usize| format!("({})", vec![one; n].join(", "));
    if let Some(choice) = input.choices.first() {
        return Some(choice.name.to_owned());
    }
    Some(match name {
        "number" => number,
        "whole number" => whole,
        "true or false" => "false".to_owned(),
        "text" => "\"a\"".to_owned(),
        "pair of numbers" => repeated(&number, 2),
        "three numbers" => repeated(&number, 3),
        "four numbers" => repeated(&number, 4),
        "pair of whole numbers" => repeated(&whole, 2),
        "four whole numbers" => repeated(&whole, 4),
        "list of numbers" => format!("[{number}, {number}]"),
        "list of whole numbers" => format!("[{whole}, {whole}]"),
        "list of pairs of numbers" => format!("[{0}, {0}]", repeated(&number, 2)),
        "list of triples of numbers" => format!("[{0}, {0}]", repeated(&number, 3)),
        "list of four numbers each" => format!("[{0}, {0}]", repeated(&number, 4)),
        "list of lists of numbers" => format!("[[{number}], [{number}]]"),
        "list of texts" => "[\"a\"]".to_owned(),
        "clock" => "\"frames\"".to_owned(),
        "path to write" => "\"$out/check.####.png\"".to_owned(),
        _ => return None,
    })
}

/// Literals at the ends of what a setting takes.
pub(super) fn extremes(name: &str, input: &InputSchema) -> Vec<String> {
    if !input.choices.is_empty() {
        return input.choices.iter().map(|c| c.name.to_owned()).collect();
    }
    let (least, most) = input.range.unwrap_or((-1e3, 1e3));
    // A count of four thousand millions says that there is no end, and nobody has time for it.
    let (least, most) = (least.max(-1e6), if name.contains("whole") { most.min(4096.0) } else { most.min(1e6) });
    let ends = |is_whole: bool, n: usize| {
        let one = |end: f64| if is_whole { format!("{}", end as i64) } else { format!("{end:?}") };
        [least, most].map(|end| if n == 1 { one(end) } else { format!("({})", vec![one(end); n].join(", ")) }).to_vec()
    };
    let texts = |list: &[&str]| list.iter().map(|s| (*s).to_owned()).collect();
    match name {
        "number" => ends(false, 1),
        "pair of numbers" => ends(false, 2),
        "three numbers" => ends(false, 3),
        "four numbers" => ends(false, 4),
        "whole number" => ends(true, 1),
        "pair of whole numbers" => ends(true, 2),
        "four whole numbers" => ends(true, 4),
        "true or false" => texts(&["true", "false"]),
        "text" => texts(&["\"\"", "\"f\u{fc}r \u{130a8}\""]),
        _ if name.starts_with("list of") => texts(&["[]"]),
        _ => Vec::new(),
    }
}
