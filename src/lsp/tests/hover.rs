//! Hover.

use serde_json::{Value, json};

use super::client::{marked, slice};
use super::{MAIN, shown};

#[test]
fn everything_that_has_a_meaning_tells_it() {
    let mut client = shown();
    for (place, mark, word, parts) in [
        (
            "\"comp.over\"",
            "\"comp.|over\"",
            "comp.over",
            vec!["Lays one picture over another", "`fg`: Image; must be given", "Porter, Duff"],
        ),
        ("\"sky\":", "\"s|ky\":", "sky", vec!["image.constant", "The sky behind all.", "`image`: Image; one value for the whole graph"]),
        ("\"@hat\"", "\"@h|at\"", "hat", vec!["graph:lib/soft.ron", "`soft`: Image", "`sharp`: Image", "Softens a picture."]),
        ("\"@hat.soft\"", "\"@hat.so|ft\"", "soft", vec!["@hat.soft", "`soft`: Image"]),
        ("opacity: 0.5", "op|acity: 0.5", "opacity", vec!["number, or a Curve; 0 to 1; default `1.0`", "0 leaves the background alone"]),
        ("opacity: 0.5", "opacity: 0|.5", "0.5", vec!["0 to 1"]),
        ("size: (64, 32)", "size: (6|4, 32)", "(64, 32)", vec!["in px", "1 to 65536"]),
        ("\"$softness\"", "\"$soft|ness\"", "softness", vec!["number; default `0.25`", "How soft it is"]),
        ("\"softness\":", "\"soft|ness\":", "softness", vec!["number; default `0.25`"]),
        ("size: \"$soft", "si|ze: \"$soft", "size", vec!["any; default `0.5`", "By how much"]),
        ("graph:lib", "gr|aph:lib", "graph:lib/soft.ron", vec!["Softens a picture.", "`image`: Image; must be given", "`sharp`"]),
        ("\"number\"", "\"num|ber\"", "number", vec!["A number."]),
        ("\"image\": \"@comp\"", "\"im|age\": \"@comp\"", "image", vec!["@comp"]),
        ("frames: (", "fra|mes: (", "frames", vec!["The default clock"]),
        ("$out/", "$o|ut/", "out", vec!["the output folder"]),
    ] {
        let given = MAIN.replacen(place, mark, 1);
        let found = client.at_mark("hover", "main.ron", &given, json!({})).unwrap();
        let text = found["contents"]["value"].as_str().unwrap_or_else(|| panic!("nothing at {mark}"));
        parts.iter().for_each(|part| assert!(text.contains(part), "{mark}: no `{part}` in\n{text}"));
        assert_eq!(slice(MAIN, &found["range"]), word, "{mark}");
        assert_eq!(found["contents"]["kind"], "markdown");
    }
    for mark in ["peg|bar: 1".replace("peg|bar", "pegbar|"), "first: 1|".to_owned()] {
        let given = MAIN.replacen(&mark.replace('|', ""), &mark, 1);
        let found = client.at_mark("hover", "main.ron", &given, json!({})).unwrap();
        assert!(found.is_null() || found["contents"]["value"].as_str().unwrap().contains("graph format"), "{mark}: {found}");
    }
}

#[test]
fn rate_and_clock_are_told_as_they_were_found_out() {
    let mut client = shown();
    let text = MAIN
        .replace("        \"out\":", "        \"slow\": (type: \"time.resample\", stream: \"@comp\", clock: \"film\"),\n        \"out\":");
    let given = text.replace("\"slow\"", "\"sl|ow\"");
    let found = client.at_mark("hover", "main.ron", &given, json!({})).unwrap();
    let said = found["contents"]["value"].as_str().unwrap();
    assert!(said.contains("Image; one value a frame; clock `film`, 1 to 10 at 5 fps"), "{said}");
    // Also in a graph that is wrong elsewhere, and at what is wrong itself what the code means.
    let given = given.replace("\"comp.over\"", "\"comp.ovre\"").replace("sl|ow", "slow").replace("ovre\"", "ov|re\"");
    let found = client.at_mark("hover", "main.ron", &given, json!({})).unwrap();
    let said = found["contents"]["value"].as_str().unwrap();
    assert!(said.contains("PB0120") && said.contains("`pegbar nodes` lists the node types"), "{said}");
}

#[test]
fn words_of_an_enumeration_tell_what_they_mean() {
    let mut client = shown();
    let given = MAIN.replace("        \"out\":", "        \"b\": (type: \"image.blur\", image: \"@sky\", kernel: bo|x),\n        \"out\":");
    let found = client.at_mark("hover", "main.ron", &given, json!({})).unwrap();
    assert!(found["contents"]["value"].as_str().unwrap().starts_with("`box`: All alike"), "{found}");
}

#[test]
fn nothing_is_told_where_there_is_nothing() {
    let mut client = shown();
    let (text, position) = marked(&MAIN.replace("// A show.", "// A |show."));
    client.open("main.ron", &text);
    assert_eq!(client.at("hover", "main.ron", &position, json!({})), Ok(Value::Null));
    let beyond = json!({ "line": 9999, "character": 9999 });
    assert_eq!(client.at("hover", "main.ron", &beyond, json!({})), Ok(Value::Null));
}
