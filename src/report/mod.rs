//! `pegbar run --report`: one page that shows a run: the graph with what each node cost, what came out of each, the settings and who made them, what
//! failed and what was written. It stands by itself: pictures are in it, and nothing is fetched.

mod catch;
mod html;
mod numbers;
mod page;
mod picture;
mod plot;
mod settings;
mod show;
mod sketch;
mod values;

use std::io::{self, Write};
use std::path::Path;

use pegbar_engine::atomic::{self, WriteError};

pub(crate) use catch::Catcher;
use html::escape;
pub(crate) use html::{base64, number};
pub(crate) use numbers::is_numbers;
pub(crate) use page::Facts;
pub(crate) use picture::Thumb;
pub(crate) use show::{is_picture, thumb, thumb_of_file};

const TEMPLATE: &str = include_str!("template.html");

/// Writes the page of a run that has ended.
pub(crate) fn write(path: &Path, facts: &Facts<'_>, catcher: Catcher) -> Result<(), WriteError<io::Error>> {
    let page = page::Page::new(facts, catcher);
    fill(path, &page.title(), &page.style(), &page.body())
}

/// Writes what stands there until the run has ended: so a path that cannot be written is known from the start, and no earlier run's page is taken for
/// this one's.
pub(crate) fn write_unended(path: &Path, graph: &Path) -> Result<(), WriteError<io::Error>> {
    let name = escape(&graph.display().to_string());
    let body = format!("<h1>{name} <span class=\"state unended\">not ended</span></h1><p>This run has not ended yet, or was cut off.</p>");
    fill(path, &name, "", &body)
}

fn fill(path: &Path, title: &str, style: &str, body: &str) -> Result<(), WriteError<io::Error>> {
    let parts = [("{{version}}", env!("CARGO_PKG_VERSION")), ("{{title}}", title), ("{{style}}", style), ("{{body}}", body)];
    atomic::write(path, |out| {
        // Each part stands in the template once, in this order, and what is put in is not looked at again.
        let mut rest = TEMPLATE;
        for (name, part) in parts {
            let (before, after) = rest.split_once(name).unwrap_or((rest, ""));
            write!(out, "{before}{part}")?;
            rest = after;
        }
        write!(out, "{rest}")
    })
}

#[cfg(test)]
mod tests;
