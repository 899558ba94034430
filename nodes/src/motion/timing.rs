//! What nodes of keyframes share: the list of one setting, the checks of another.

use pegbar_engine::node::Problem;
use pegbar_engine::setting::{Choice, Setting, SettingError};
use pegbar_engine::syntax::{NodeKind, NodeRef, Tree};

use crate::algo::keyframes::Easing;

/// An easing, or a list of them: `smooth`, `[slow_in, slow_out]`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Easings(pub(crate) Vec<Easing>);

impl Setting for Easings {
    fn type_name() -> String {
        format!("{}, or a list of these", Easing::type_name())
    }

    fn choices() -> Vec<Choice> {
        Easing::choices()
    }

    fn parse(text: &str) -> Result<Self, SettingError> {
        let tree = Tree::parse(text);
        let Some(list) = tree.value().filter(|v| v.kind() == NodeKind::List) else {
            return Easing::parse(text).map(|e| Self(vec![e]));
        };
        let one = |word: NodeRef<'_>| Easing::parse(word.text()).map_err(|e| SettingError { span: word.span().range(), ..e });
        list.elements().map(one).collect::<Result<_, _>>().map(Self)
    }
}

/// A problem with an input, where there is one.
pub(crate) fn unless(fine: bool, input: &'static str, message: impl FnOnce() -> String) -> Option<Problem> {
    (!fine).then(|| Problem { input, message: message() })
}

/// What is wrong with the frames of keys, and with an easing for each of them.
pub(crate) fn problems(frames: &[i64], easing: &Easings) -> Vec<Problem> {
    let late = frames.windows(2).position(|w| w[0] >= w[1]);
    let order = || {
        let at = late.unwrap_or(0);
        format!("expected each frame later than the one before, found {} after {} at position {}", frames[at + 1], frames[at], at + 2)
    };
    let (n, e) = (frames.len(), easing.0.len());
    let found = [
        unless(n > 0, "frames", || "expected a frame for each key, found none".to_owned()),
        unless(late.is_none(), "frames", order),
        unless(e == 1 || e == n || e + 1 == n, "easing", || format!("expected one easing, or one for each of {n} keys, found {e}")),
    ];
    found.into_iter().flatten().collect()
}

/// A problem where there is neither one entry for all keys nor one for each, or one of them is no number.
pub(crate) fn each(input: &'static str, keys: usize, entries: usize, numbers: &[f64]) -> Vec<Problem> {
    let found = [
        unless(entries == 1 || entries == keys, input, || format!("expected one entry, or one for each of {keys} keys, found {entries}")),
        unless(numbers.iter().all(|v| v.is_finite()), input, || "expected finite numbers, found NaN or infinity".to_owned()),
    ];
    found.into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn easings_are_a_word_or_a_list_with_comments() {
        let read = |text: &str| Easings::parse(text).map(|e| e.0);
        assert_eq!(read(" smooth "), Ok(vec![Easing::Smooth]));
        assert_eq!(read("[hold, // off the ground\n /* and */ slow_in,]"), Ok(vec![Easing::Hold, Easing::SlowIn]));
        assert_eq!(read("[]"), Ok(Vec::new()));
        let error = read("[hold, bouncy]").unwrap_err();
        assert_eq!((error.span.clone(), error.message.ends_with("found bouncy")), (7..13, true), "{error:?}");
        assert!(read("[hold, 3]").is_err() && read("(hold)").is_err());
    }
}
