//! What a plugin says of itself, as its users will read it.

use super::{Checked, Finding, Stop};
use crate::plugin::manifest::{Description, InputText, NodeText, PortType, TypeText};

/// Checks the schema and the words of a description that holds together ([`Description::validate`]).
pub fn texts(plugin: &Description) -> Vec<Finding> {
    let all = plugin.nodes.iter().flat_map(|node| {
        let id = Some(node.id.as_str());
        [Finding::of("schema", id, schema(node)), Finding::of("docs", id, docs(node))]
    });
    let own = documented(&format!("plugin `{}`", plugin.name), &plugin.doc).and_then(|()| plugin.values.iter().try_for_each(type_docs));
    std::iter::once(Finding::of("docs", None, own)).chain(all).collect()
}

/// A sentence that says more than nothing.
fn documented(what: &str, doc: &str) -> Checked {
    let first = doc.split("\n\n").next().unwrap_or_default().trim();
    if first.ends_with(['.', '!', '?']) && first.chars().count() > 3 {
        return Ok(());
    }
    let help = "users read it in `pegbar explain` and in their editor";
    Err(Stop::failed(format!("{what}: expected a sentence with a full stop, found {doc:?}")).help(help))
}

fn type_docs(ty: &TypeText) -> Checked {
    let of = |what: &str, name: &str| format!("value type `{}`, {what} `{name}`", ty.name);
    documented(&format!("value type `{}`", ty.name), &ty.doc)?;
    ty.arrays.iter().try_for_each(|a| documented(&of("array", &a.name), &a.doc))?;
    ty.texts.iter().try_for_each(|t| documented(&of("text", &t.name), &t.doc))
}

fn docs(node: &NodeText) -> Checked {
    documented("the node", &node.doc)?;
    for input in &node.inputs {
        let at = format!("input `{}`", input.name);
        documented(&at, &input.doc)?;
        input.choices.iter().try_for_each(|(word, doc)| documented(&format!("{at}, `{word}`"), doc))?;
        // A count or a seed has no unit; of a measure nobody knows what 1 is unless it has one, or two ends.
        if input.ty == PortType::Setting("number".to_owned()) && input.unit.is_none() && input.range.is_none() {
            let help = "give it a `unit`, as \"px\" or \"degrees\", or a `range` whose ends the doc explains";
            return Err(Stop::failed(format!("{at}: expected a number with a unit or a range, found neither")).help(help));
        }
    }
    node.outputs.iter().try_for_each(|o| documented(&format!("output `{}`", o.name), &o.doc))?;
    node.state.as_ref().map_or(Ok(()), type_docs)
}

fn schema(node: &NodeText) -> Checked {
    if node.version == 0 {
        return Err(Stop::failed("expected a version of the node from 1 on, found 0"));
    }
    let mut names: Vec<&str> = node.outputs.iter().map(|o| o.name.as_str()).collect();
    names.sort_unstable();
    if let Some(twice) = names.windows(2).find(|pair| pair[0] == pair[1]) {
        return Err(Stop::failed(format!("expected each output once, found `{}` twice", twice[0])));
    }
    if names.is_empty() && node.kind != crate::node::Kind::Sink {
        return Err(Stop::failed("expected an output, found none").help("a node that writes files and makes nothing has `kind: sink`"));
    }
    if let Some(example) = node.example.as_ref().filter(|e| !e.contains(&format!("\"{}\"", node.id))) {
        return Err(Stop::failed(format!("expected an example of `{}`, found {example}", node.id)));
    }
    node.inputs.iter().try_for_each(input)
}

fn input(input: &InputText) -> Checked {
    let wrong = |why: String| Err(Stop::failed(format!("input `{}`: {why}", input.name)));
    let numbers = match (&input.ty, &input.default) {
        (PortType::Setting(_), Some(default)) => {
            let schema = input.schema().map_err(Stop::failed)?;
            (schema.parse)(default, &crate::setting::Place::default()).map(|(_, numbers)| numbers).unwrap_or_default()
        }
        _ => Vec::new(),
    };
    match input.range {
        Some((least, most)) if least.partial_cmp(&most) != Some(std::cmp::Ordering::Less) => {
            return wrong(format!("expected a range that ascends, found {least} to {most}"));
        }
        Some((least, most)) => {
            if let Some(outside) = numbers.iter().find(|n| !(least..=most).contains(*n)) {
                return wrong(format!("expected a default from {least} to {most}, found {outside}"));
            }
        }
        None => {}
    }
    let mut words: Vec<&str> = input.choices.iter().map(|(word, _)| word.as_str()).collect();
    words.sort_unstable();
    match words.windows(2).find(|pair| pair[0] == pair[1]) {
        Some(twice) => wrong(format!("expected each word once, found `{}` twice", twice[0])),
        None => Ok(()),
    }
}
