//! Results as JUnit XML, as Jenkins and GitLab read it: a suite a graph and case, a test an output.

use std::fmt::Write as _;

use super::case::{CaseResult, Verdict};

/// Text as it stands in XML: characters that XML does not have are left out.
pub(super) fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\n' | '\t' => out.push(c),
            c if c < ' ' || matches!(c, '\u{fffe}' | '\u{ffff}') => (),
            c => out.push(c),
        }
    }
    out
}

/// In an attribute a line end would become a space.
fn attribute(text: &str) -> String {
    escaped(text).replace('\n', "&#10;").replace('\t', "&#9;")
}

/// One test: an output of a case, or the case itself where it did not come to its outputs.
struct Test<'a> {
    name: &'a str,
    /// `failure` or `error`, what it says in short, and all of it.
    wrong: Option<(&'static str, String, String)>,
}

fn tests(result: &CaseResult) -> Vec<Test<'_>> {
    let of_output = |output: &super::case::OutputResult| -> Option<(&'static str, String, String)> {
        let (frame, first) = output.wrong.iter().next()?;
        let lines: String = output.wrong.iter().flat_map(|(f, said)| said.iter().map(move |s| format!("frame {f}: {s}\n"))).collect();
        Some(("failure", format!("frame {frame}: {}", first.join("; ")), format!("{lines}\n{}", result.said)))
    };
    let outputs = result.outputs.iter().map(|o| Test { name: &o.name, wrong: of_output(o).filter(|_| result.verdict != Verdict::Pass) });
    let mut tests: Vec<Test> = outputs.collect();
    if result.verdict == Verdict::Pass && !tests.is_empty() || tests.iter().any(|t| t.wrong.is_some()) {
        return tests;
    }
    let first = result.said.lines().next().unwrap_or_default().to_owned();
    let wrong = match result.verdict {
        Verdict::Pass => None,
        Verdict::Left => Some(("failure", first, result.said.clone())),
        Verdict::Wrong => Some(("error", first, result.said.clone())),
        Verdict::Cancelled => Some(("error", "cancelled".to_owned(), "cancelled".to_owned())),
    };
    tests.clear();
    tests.push(Test { name: "graph", wrong });
    tests
}

/// The whole report.
pub(super) fn junit(results: &[CaseResult]) -> String {
    let mut suites = String::new();
    let (mut all, mut failures, mut errors, mut seconds) = (0, 0, 0, 0.0);
    for result in results {
        let tests = tests(result);
        let count = |what: &str| tests.iter().filter(|t| t.wrong.as_ref().is_some_and(|(w, _, _)| *w == what)).count();
        let (failed, wrong, time) = (count("failure"), count("error"), result.time.as_secs_f64());
        let suite = format!("{}: {}", result.graph.display(), result.case);
        // Writing into a string cannot fail.
        let _ = writeln!(
            suites,
            "  <testsuite name=\"{}\" tests=\"{}\" failures=\"{failed}\" errors=\"{wrong}\" skipped=\"0\" time=\"{time:.3}\">",
            attribute(&suite),
            tests.len()
        );
        let class = result.graph.with_extension("").display().to_string().trim_start_matches("./").replace('/', ".");
        for test in &tests {
            // One run makes all outputs of a case, so that each is said to take its part of it.
            let part = time / tests.len() as f64;
            let name = attribute(&format!("{}: {}", result.case, test.name));
            let _ = write!(suites, "    <testcase classname=\"{}\" name=\"{name}\" time=\"{part:.3}\"", attribute(&class));
            let _ = match &test.wrong {
                None => writeln!(suites, "/>"),
                Some((what, short, text)) => {
                    writeln!(suites, ">\n      <{what} message=\"{}\">{}</{what}>\n    </testcase>", attribute(short), escaped(text))
                }
            };
        }
        suites.push_str("  </testsuite>\n");
        (all, failures, errors, seconds) = (all + tests.len(), failures + failed, errors + wrong, seconds + time);
    }
    let head = format!("tests=\"{all}\" failures=\"{failures}\" errors=\"{errors}\" time=\"{seconds:.3}\"");
    format!("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites name=\"pegbar test\" {head}>\n{suites}</testsuites>\n")
}
