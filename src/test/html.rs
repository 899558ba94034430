//! A page to review what changed: one file, without anything from elsewhere.

use std::fmt::Write as _;

use super::case::{CaseResult, Shown, Verdict};
use super::junit::escaped;
use crate::report::base64;
use crate::summary::duration;

const PAGE: &str = include_str!("page.html");

/// The page of a run of tests; what failed or changed comes open, the rest closed.
pub(super) fn page(results: &[CaseResult], subtitle: &str) -> String {
    let mut order: Vec<&CaseResult> = results.iter().collect();
    order.sort_by_key(|r| (r.verdict == Verdict::Pass, r.shown.is_empty()));
    let cases: String = order.into_iter().map(case).collect();
    let hidden = if results.iter().all(|r| r.shown.is_empty()) { "hidden style=\"display: none\"" } else { "" };
    // What results say may hold anything, so it is put in last.
    let page = PAGE.replace("{{title}}", "pegbar test").replace("{{subtitle}}", &escaped(subtitle)).replace("{{hidden}}", hidden);
    page.replace("{{cases}}", &cases)
}

/// What is said of a verdict: a class and a word.
fn word(result: &CaseResult) -> (&'static str, &'static str) {
    match (result.verdict, result.blessed) {
        (Verdict::Pass, true) => ("pass", "blessed"),
        (Verdict::Pass, false) => ("pass", "pass"),
        (Verdict::Left, _) => ("left", "failed"),
        (Verdict::Wrong, _) => ("wrong", "error"),
        (Verdict::Cancelled, _) => ("cancelled", "cancelled"),
    }
}

fn case(result: &CaseResult) -> String {
    let (class, word) = word(result);
    let open = if result.verdict != Verdict::Pass || !result.shown.is_empty() { " open" } else { "" };
    let name = escaped(&format!("{}: {}", result.graph.display(), result.case));
    let mut out = format!("<details class=\"case\"{open}><summary><span class=\"state {class}\">{word}</span>{name}");
    // Writing into a string cannot fail.
    let _ = writeln!(out, "<span class=\"soft\">{}</span></summary><div>", duration(result.time));
    if !result.said.is_empty() {
        let _ = writeln!(out, "<pre>{}</pre>", escaped(result.said.trim_end()));
    }
    if !result.outputs.is_empty() {
        out.push_str(&outputs(result));
    }
    result.shown.iter().for_each(|s| out.push_str(&pictures(s)));
    out.push_str("</div></details>\n");
    out
}

fn outputs(result: &CaseResult) -> String {
    // What came to no comparison is neither right nor wrong.
    let has_compared = result.outputs.iter().any(|o| !o.wrong.is_empty());
    let mut out = "<table><tr><th>output</th><th>type</th><th>frames</th><th></th></tr>\n".to_owned();
    for output in &result.outputs {
        let frames = pegbar_engine::job::frame_ranges(&output.frames);
        let _ = write!(out, "<tr><td>{}</td><td>{}</td><td>{frames}</td><td>", escaped(&output.name), escaped(&output.type_name));
        for (frame, what) in output.wrong.iter().flat_map(|(frame, said)| said.iter().map(move |s| (frame, s))) {
            let _ = write!(out, "<div>frame {frame}: {}</div>", escaped(what));
        }
        if output.wrong.is_empty() && (result.verdict == Verdict::Pass || has_compared) {
            out.push_str(if output.other_bits > 0 { "within its tolerance, of other bits" } else { "as the reference" });
        }
        out.push_str("</td></tr>\n");
    }
    out + "</table>\n"
}

fn pictures(shown: &Shown) -> String {
    let uri = |png: &[u8]| format!("data:image/png;base64,{}", base64(png));
    let img = |png: &[u8], what: &str| format!("<img src=\"{}\" alt=\"{what}\">", uri(png));
    let figure = |class: &str, caption: &str, content: &str| {
        format!("<figure class=\"{class}\"><div class=\"picture\">{content}</div><figcaption>{caption}</figcaption></figure>\n")
    };
    let mut out = format!("<h3>{} at frame {}</h3>\n", escaped(&shown.output), shown.frame);
    let actual = img(&shown.actual, "actual");
    let Some(expected) = &shown.expected else {
        let _ = writeln!(
            out,
            "<div class=\"review alone\">{}</div>",
            figure("actual", "actual; there is no picture to hold it against", &actual)
        );
        return out;
    };
    let expected = img(expected, "expected");
    out.push_str("<div class=\"review\">\n");
    out.push_str(&figure("expected", "expected", &expected));
    out.push_str(&figure("actual", "actual", &actual));
    out.push_str(&figure("both", "expected, and actual over it", &format!("{expected}{actual}")));
    match &shown.difference {
        Some(d) => {
            let (worst, x, y) = d.worst;
            let caption = format!("difference: {} of {} pixels; most {worst:.0} codes at ({x}, {y})", d.beyond.0, d.beyond.1);
            out.push_str(&figure("difference", &caption, &img(&d.png, "difference")));
        }
        None => out.push_str("<p class=\"soft\">of other extents</p>\n"),
    }
    out + "</div>\n"
}
