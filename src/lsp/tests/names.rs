//! From names to what they name, and other names for it.

use pegbar_engine::check::LoadOptions;
use serde_json::{Value, json};

use super::client::{edited, marked, slice};
use super::{Client, MAIN, SOFT, shown};

/// Where the name at the mark is declared: file, and the text there.
fn definition(client: &mut Client, given: &str) -> Option<(String, String)> {
    let found = client.at_mark("definition", "main.ron", given, json!({})).unwrap();
    let name = found["uri"].as_str()?.rsplit('/').next()?.to_owned();
    let text = if name == "main.ron" { marked(given).0 } else { SOFT.to_owned() };
    Some((name, slice(&text, &found["range"]).to_owned()))
}

#[test]
fn names_lead_to_where_they_are_declared() {
    let mut client = shown();
    for (place, mark, file, text) in [
        ("\"@hat\"", "\"@h|at\"", "main.ron", "hat"),
        ("\"@sky\"", "\"|@sky\"", "", ""),
        ("\"hat\":", "\"ha|t\":", "main.ron", "hat"),
        ("\"@hat.soft\"", "\"@hat.so|ft\"", "soft.ron", "soft"),
        ("\"$softness\"", "\"$soft|ness\"", "main.ron", "softness"),
        ("size: \"$soft", "si|ze: \"$soft", "soft.ron", "size"),
        ("graph:lib", "gra|ph:lib", "soft.ron", ""),
        ("comp.over", "comp.o|ver", "", ""),
        ("\"image\": \"@comp\"", "\"image\": \"@co|mp\"", "main.ron", "comp"),
    ] {
        let found = definition(&mut client, &MAIN.replacen(place, mark, 1));
        let expected = (!file.is_empty()).then(|| (file.to_owned(), text.to_owned()));
        assert_eq!(found, expected, "{mark}");
    }
    let with_port = MAIN.replace("fg: \"@hat\"", "fg: \"@sky.im|age\"");
    assert_eq!(definition(&mut client, &with_port), Some(("main.ron".to_owned(), "sky".to_owned())), "an output of a plain node");
}

#[test]
fn graphs_of_the_library_are_found_with_their_versions() {
    let folder = tempfile::tempdir().unwrap();
    let library = folder.path().join("shared");
    let mut client = Client::with(folder, LoadOptions { library: vec![library], ..LoadOptions::default() });
    client.initialize(json!({}));
    client.write("shared/lib/soft.ron", &SOFT.replacen("pegbar: 1,", "pegbar: 1, version: \"1.2.0\",", 1));
    let text = MAIN.replace("lib/soft.ron", "lib/soft.ron@1.1");
    let found = client.at_mark("definition", "main.ron", &text.replacen("graph:", "gr|aph:", 1), json!({})).unwrap();
    assert!(found["uri"].as_str().unwrap().ends_with("/shared/lib/soft.ron"), "{found}");
    assert_eq!(client.said("main.ron"), Vec::<String>::new());
    client.open("main.ron", &text.replace("@1.1", "@2.0"));
    assert_eq!(client.said("main.ron").len(), 1);
}

/// Lines of the references of the name at the mark, by file.
fn references(client: &mut Client, given: &str, declared: bool) -> Vec<(String, u64)> {
    let more = json!({ "context": { "includeDeclaration": declared } });
    let found = client.at_mark("references", "main.ron", given, more).unwrap();
    let place =
        |r: &Value| (r["uri"].as_str().unwrap().rsplit('/').next().unwrap().to_owned(), r["range"]["start"]["line"].as_u64().unwrap());
    found.as_array().unwrap().iter().map(place).collect()
}

#[test]
fn all_that_means_the_same_is_found() {
    let mut client = shown();
    let main = |lines: &[u64]| lines.iter().map(|l| ("main.ron".to_owned(), *l)).collect::<Vec<_>>();
    let of_sky = MAIN.replacen("\"sky\":", "\"s|ky\":", 1);
    assert_eq!(references(&mut client, &of_sky, true), main(&[10, 11, 13]));
    assert_eq!(references(&mut client, &of_sky, false), main(&[11, 13]));
    // An output of a graph that is open: where it is declared, and where this file takes it.
    client.open("lib/soft.ron", SOFT);
    let of_soft = MAIN.replacen("hat.soft", "hat.so|ft", 1);
    assert_eq!(references(&mut client, &of_soft, true), [("soft.ron".to_owned(), 11), ("main.ron".to_owned(), 12)]);
    let highlights = client.at_mark("documentHighlight", "main.ron", &of_sky, json!({})).unwrap();
    assert_eq!(highlights.as_array().unwrap().len(), 3);
}

/// Each file after a renaming.
fn renamed(client: &mut Client, given: &str, name: &str) -> Result<Vec<(String, String)>, Value> {
    let edit = client.at_mark("rename", "main.ron", given, json!({ "newName": name }))?;
    let files = edit["changes"].as_object().unwrap().iter().map(|(uri, edits)| {
        let file = uri.rsplit('/').next().unwrap().to_owned();
        let text = if file == "main.ron" { marked(given).0 } else { SOFT.to_owned() };
        (file, edited(&text, edits))
    });
    Ok(files.collect())
}

#[test]
fn nodes_are_renamed_wherever_they_are_meant() {
    let mut client = shown();
    let files = renamed(&mut client, &MAIN.replacen("\"@hat\"", "\"@h|at\"", 1), "cap").unwrap();
    let expected = MAIN.replace("\"hat\"", "\"cap\"").replace("@hat", "@cap");
    assert_eq!(files, [("main.ron".to_owned(), expected.clone())]);
    client.open("main.ron", &expected);
    assert_eq!(client.said("main.ron"), Vec::<String>::new());
}

#[test]
fn parameters_are_renamed_with_those_open_callers_who_give_them() {
    let mut client = shown();
    client.open("lib/soft.ron", SOFT);
    let files = renamed(&mut client, &MAIN.replacen("size: \"$soft", "si|ze: \"$soft", 1), "$amount").unwrap();
    let main = MAIN.replace("size: \"$soft", "amount: \"$soft");
    let soft = SOFT.replace("\"size\"", "\"amount\"").replace("$size", "$amount");
    assert_eq!(files, [("soft.ron".to_owned(), soft), ("main.ron".to_owned(), main)]);
    let said = client.note("window/showMessage");
    assert!(said["message"].as_str().unwrap().contains("graphs that are not open and give `size` keep the old name"), "{said}");

    let files = renamed(&mut client, &MAIN.replacen("hat.soft", "hat.so|ft", 1), "blurred").unwrap();
    assert_eq!(files[1].1, MAIN.replace("hat.soft", "hat.blurred"));
    assert_eq!(files[0].1, SOFT.replace("\"soft\"", "\"blurred\""));
}

#[test]
fn names_that_cannot_be_are_refused() {
    let mut client = shown();
    let node = MAIN.replacen("\"hat\":", "\"h|at\":", 1);
    let param = MAIN.replacen("\"softness\":", "\"soft|ness\":", 1);
    let plain = MAIN.replacen("comp.over", "comp.o|ver", 1);
    for (given, name, part) in [
        (&node, "", "found none"),
        (&node, "a.b", "without `.`"),
        (&node, "sky", "not there yet, found `sky`"),
        (&param, "a b", "letters, digits"),
        (&param, "out", "output folder"),
        (&plain, "over", "expected a node, a parameter or an output"),
    ] {
        let refused = renamed(&mut client, given, name).unwrap_err();
        assert!(refused["message"].as_str().unwrap().contains(part), "{name}: {refused}");
    }
    assert!(renamed(&mut client, &node, "hat").is_ok(), "the name that it has");
    let prepared = client.at_mark("prepareRename", "main.ron", &node, json!({})).unwrap();
    assert_eq!((slice(MAIN, &prepared["range"]), prepared["placeholder"].as_str()), ("hat", Some("hat")));
    assert_eq!(client.at_mark("prepareRename", "main.ron", &plain, json!({})), Ok(Value::Null));
}
