//! Literals such that equal values read the same.

use std::collections::BTreeMap;

use crate::syntax::{NodeKind, NodeRef, TokenKind, Tree};

/// A literal such that equal values read the same: no blanks or comments, no comma before a bracket that closes, numbers and texts by their
/// values, and a word of an enumeration without quotes.
pub(super) fn canonical(text: &str, is_word: bool) -> String {
    let tree = Tree::parse(text.to_owned());
    if let Some(word) = tree.value().filter(|_| is_word).and_then(NodeRef::as_str) {
        return word.into_value().into_owned();
    }
    let mut out = String::new();
    let texts: BTreeMap<usize, String> = (tree.root().descendants().filter(|n| n.kind() == NodeKind::String))
        .filter_map(|n| Some((n.span().start, format!("{:?}", n.as_str()?.into_value()))))
        .collect();
    for token in tree.tokens().filter(|t| !t.kind().is_trivia()) {
        if matches!(token.kind(), TokenKind::RParen | TokenKind::RBracket | TokenKind::RBrace) && out.ends_with(',') {
            out.pop();
        }
        match (texts.get(&token.span().start), token.kind()) {
            (Some(text), _) => out.push_str(text),
            (None, TokenKind::Number) => out.push_str(&number(token.text())),
            (None, _) => out.push_str(token.text()),
        }
    }
    out
}

/// A number by its value: whole numbers as such, all others in the shortest form that reads back the same.
fn number(text: &str) -> String {
    let plain = text.replace('_', "");
    let whole = plain.strip_prefix('+').unwrap_or(&plain);
    if let Ok(n) = whole.parse::<i128>() {
        // Minus nought is another float than nought.
        return if n == 0 && whole.starts_with('-') { "-0".to_owned() } else { n.to_string() };
    }
    match plain.parse::<f64>() {
        // Above that not every whole number is a float, so that the two forms may differ.
        Ok(n) if n == n.trunc() && n.abs() < 9e15 => format!("{n:.0}"),
        Ok(n) => format!("{n:e}"),
        Err(_) => plain,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_literals_read_the_same() {
        let same = [
            ("1.0", "1.00"),
            ("1", "1.0"),
            ("1e3", "1000"),
            ("1_000", "+1000"),
            ("[1, 2,]", "[ 1,2.0 ]"),
            ("(0.5,)", "(5e-1)"),
            ("\"a\\u{62}\"", "r\"ab\""),
            ("-0", "-0.0"),
            ("[/* no */ 1]", "[1]"),
        ];
        for (a, b) in same {
            assert_eq!(canonical(a, false), canonical(b, false), "{a} {b}");
        }
        let other = [
            ("0", "-0"),
            ("1", "1.0000000000000002"),
            ("\"1\"", "1"),
            ("[1,2]", "[12]"),
            ("\"a b\"", "\"ab\""),
            ("1e16", "1e17"),
            ("\",]\"", "\"]\""),
        ];
        for (a, b) in other {
            assert_ne!(canonical(a, false), canonical(b, false), "{a} {b}");
        }
        assert_eq!(canonical("\"cubic\"", true), canonical("cubic", true));
    }
}
