//! `pegbar wedge`: a graph run over ranges of its settings. Every variant is a run of its own, one after the other, with its own output folder; what they
//! have in common is made by the first and taken from the cache by the others.

mod axes;
mod probe;
mod share;
mod sheet;

use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;
use std::time::Duration;

use pegbar_engine::atomic;
use pegbar_engine::check::{LoadOptions, Loaded, load};
use pegbar_engine::exec::Policy;
use pegbar_engine::graph::{Binding, Graph, Port};
use pegbar_engine::job::{Job, Outcome, Request};
use pegbar_engine::registry::Registry;

use crate::args::WedgeArgs;
use crate::console::{Console, EXIT_CANCELLED, EXIT_FAILED, EXIT_OK, EXIT_WRONG, count};
use crate::report::{Thumb, is_picture, number, thumb_of_file};
use crate::resources::Ready;
use crate::run::watched;
use crate::summary::{duration, table};

use axes::{Axis, Variant, label, variants};
use probe::{Probe, Seen, is_number};
use share::Kinships;

/// Pixels of a picture on the sheet, in wedges of few variants and of many.
const SIZES: [(usize, [usize; 2]); 3] = [(24, [320, 320]), (150, [200, 200]), (usize::MAX, [110, 110])];

/// Numbers of a variant that are told on the terminal; the table has all.
const MOST_TOLD: usize = 4;

/// What came of a variant.
struct Ran {
    /// Why it is not whole.
    failure: Option<String>,
    wall: Duration,
    tasks: u64,
    skipped: u64,
    numbers: BTreeMap<String, f64>,
    pictures: Vec<Thumb>,
}

/// Everything that the variants share.
struct Wedge<'a> {
    args: &'a WedgeArgs,
    axes: Vec<Axis>,
    variants: Vec<Variant>,
    loaded: Vec<Loaded>,
    kinships: Kinships,
    size: [usize; 2],
}

pub(crate) fn wedge(args: &WedgeArgs, registry: &Registry, console: &mut Console) -> u8 {
    let wedge = match Wedge::new(args, registry) {
        Ok(wedge) => wedge,
        Err(why) => {
            console.say(&format!("error: {why}\n"));
            return EXIT_WRONG;
        }
    };
    if let (true, Some(first)) = (wedge.loaded.iter().all(|l| l.graph.is_none()), wedge.loaded.first()) {
        console.diagnostics(&first.sources, &first.diagnostics);
        crate::check::say_total(&args.graph.graph.display().to_string(), first, console);
        return EXIT_WRONG;
    }
    let ready = Ready::new(&args.resources, console);
    if let Some(stranger) = ready.strangers(|name| wedge.loaded.iter().flat_map(|l| &l.graph).any(|g| g.find(name).is_some())).next() {
        console.say(&format!("error: expected a node of the graph in --keep, found `{stranger}`\n"));
        return EXIT_WRONG;
    }
    let mut rows = Vec::new();
    for index in 0..wedge.variants.len() {
        if console.cancel.is_cancelled() {
            break;
        }
        let ran = wedge.run(index, &ready, console);
        console.say(&wedge.line(index, &ran));
        rows.push(ran);
    }
    ready.say_trouble(console);
    wedge.conclude(&rows, console)
}

impl<'a> Wedge<'a> {
    fn new(args: &'a WedgeArgs, registry: &Registry) -> Result<Self, String> {
        let sets = args.graph.set.iter().map(|(name, text)| Axis::new(name, text, false));
        let axes: Vec<Axis> =
            sets.chain(args.graph.var.iter().map(|(name, text)| Axis::new(name, text, true))).collect::<Result<_, _>>()?;
        let variants = variants(&axes, args.zip)?;
        let loaded: Vec<Loaded> = variants.iter().map(|v| load(&args.graph.graph, registry, &options(args, &axes, v))).collect();
        let mut kinships = Kinships::default();
        // A variant that is wrong takes its place without any node.
        loaded.iter().for_each(|l| kinships.add(l.graph.as_ref().unwrap_or(&Graph::default())));
        let size = SIZES.iter().find(|(most, _)| variants.len() <= *most).map_or([110, 110], |(_, size)| *size);
        Ok(Self { args, axes, variants, loaded, kinships, size })
    }

    fn label(&self, index: usize) -> String {
        label(&self.axes, &self.variants[index].picks)
    }

    /// Runs one variant.
    fn run(&self, index: usize, ready: &Ready, console: &mut Console) -> Ran {
        let loaded = &self.loaded[index];
        let Some(graph) = &loaded.graph else {
            console.diagnostics(&loaded.sources, &loaded.diagnostics);
            return Ran::wrong(loaded.diagnostics.first().map_or("the graph is wrong", |d| &d.message));
        };
        let out = self.args.graph.out.join(&self.variants[index].folder);
        let request = Request { only: self.args.only.clone(), frames: self.args.frames.clone(), out };
        let job = match Job::new(graph, &request).and_then(|job| job.prepare().map(|()| job)) {
            Ok(job) => job,
            Err(wrong) => {
                console.diagnostics(&loaded.sources, std::slice::from_ref(&wrong));
                return Ran::wrong(&wrong.message);
            }
        };
        let named = self.args.show.as_deref().or(self.args.only.as_deref());
        let port = picture(graph, named, |port| self.kinships.shared_by(index, port.node) < self.sound());
        let numbers = self.numbers(index, graph);
        let probe = Probe::new(port, self.args.at.as_ref(), self.size, numbers.clone());
        let target =
            self.args.only.as_deref().map(|only| only.rsplit_once('.').filter(|_| graph.find(only).is_none()).map_or(only, |o| o.0));
        let policies = self.kinships.policies(index, graph, target);
        let outcome = self.job((&job, graph), loaded, &probe, &policies, ready, console);
        console.diagnostics(&loaded.sources, &outcome.diagnostics);
        Ran::new(graph, &outcome, probe.end(), &numbers, (port, self.size))
    }

    fn job(
        &self,
        (job, graph): (&Job, &Graph),
        loaded: &Loaded,
        probe: &Probe,
        shared: &[(String, Policy)],
        ready: &Ready,
        console: &mut Console,
    ) -> Outcome {
        let policies = ready.policies_with(shared);
        // Records of variants would push those of runs out, and `pegbar why` would speak of them.
        let beside = self.args.graph.graph.with_extension("wedge.ron");
        let how = ready.how_with(&beside, &loaded.sources, &policies);
        watched(self.args.progress, graph, job, &[probe], how, console)
    }

    /// Outputs that are one number and differ between variants.
    fn numbers(&self, index: usize, graph: &Graph) -> Vec<Port> {
        let all =
            (0..graph.nodes.len()).flat_map(|node| (0..graph.nodes[node].output_types.len()).map(move |output| Port { node, output }));
        let own = |port: &Port| self.kinships.shared_by(index, port.node) < self.sound();
        all.filter(|port| is_number(graph, *port) && own(port)).collect()
    }

    /// Variants whose graph is right.
    fn sound(&self) -> usize {
        self.loaded.iter().filter(|l| l.graph.is_some()).count()
    }

    fn line(&self, index: usize, ran: &Ran) -> String {
        let state = match &ran.failure {
            Some(_) => "failed".to_owned(),
            None => format!("{} ran, {} from the cache, {}", count(ran.tasks as usize, "task"), ran.skipped, duration(ran.wall)),
        };
        format!("{}/{}  {}: {state}\n", index + 1, self.variants.len(), self.label(index))
    }

    /// Writes table and sheet, and says what they say.
    fn conclude(&self, rows: &[Ran], console: &mut Console) -> u8 {
        let out = &self.args.graph.out;
        let (csv, png) = (out.join("wedge.csv"), out.join("wedge.png"));
        let lines = self.table(rows);
        console.say(&format!("\n{}\n", table(&self.told(&lines))));
        let mut wrong = written(
            &csv,
            atomic::write(&csv, |out| lines.iter().try_for_each(|line| writeln!(out, "{}", row(line)))).map_err(|e| e.to_string()),
        );
        if rows.iter().any(|r| !r.pictures.is_empty()) {
            wrong = wrong.or(written(&png, self.sheet(&png, rows)));
        } else {
            console.say("no picture to show: name an output that is one with --show NODE.OUTPUT\n");
        }
        match &wrong {
            Some(wrong) => console.say(&format!("error: {wrong}\n")),
            None => console.say(&format!(
                "table {}{}\n",
                csv.display(),
                if png.is_file() { format!(", sheet {}", png.display()) } else { String::new() }
            )),
        }
        let failed = rows.iter().filter(|r| r.failure.is_some()).count();
        if console.cancel.is_cancelled() {
            console.say("cancelled: files that are there are whole\n");
            return EXIT_CANCELLED;
        }
        if failed > 0 {
            console.say(&format!("failed: {} of {}\n", failed, count(rows.len(), "variant")));
        }
        if failed > 0 || wrong.is_some() { EXIT_FAILED } else { EXIT_OK }
    }

    /// A head, and a line for each variant: what sets it apart, how it went, its numbers.
    fn table(&self, rows: &[Ran]) -> Vec<Vec<String>> {
        let varied = || self.axes.iter().enumerate().filter(|(_, a)| a.is_varied());
        let mut names: Vec<&String> = rows.iter().flat_map(|r| r.numbers.keys()).collect();
        names.sort();
        names.dedup();
        let fixed = ["state", "seconds", "tasks", "cached"].map(str::to_owned);
        let head =
            varied().map(|(_, a)| a.name.clone()).chain(fixed).chain(names.iter().map(|n| (*n).clone())).chain(["folder".to_owned()]);
        let line = |(variant, ran): (&Variant, &Ran)| {
            let picks = varied().map(|(i, axis)| axis.values[variant.picks[i]].clone());
            let state = ran.failure.as_ref().map_or_else(|| "done".to_owned(), |why| format!("failed: {why}"));
            let fixed = [state, format!("{:.3}", ran.wall.as_secs_f64()), ran.tasks.to_string(), ran.skipped.to_string()];
            let numbers = names.iter().map(|name| ran.numbers.get(*name).map(|v| number(*v)).unwrap_or_default());
            picks.chain(fixed).chain(numbers).chain([variant.folder.clone()]).collect()
        };
        std::iter::once(head.collect()).chain(self.variants.iter().zip(rows).map(line)).collect()
    }

    /// The table as far as a terminal has room: the first few numbers.
    fn told(&self, lines: &[Vec<String>]) -> Vec<Vec<String>> {
        let kept = self.axes.iter().filter(|a| a.is_varied()).count() + 4 + MOST_TOLD;
        lines.iter().map(|line| line.iter().take(kept.min(line.len() - 1)).map(|cell| cell.chars().take(60).collect()).collect()).collect()
    }

    fn sheet(&self, path: &Path, rows: &[Ran]) -> Result<(), String> {
        let cell = |(index, ran)| cell(self.label(index), ran);
        let cells: Vec<sheet::Cell<'_>> = rows.iter().enumerate().map(cell).collect();
        sheet::write(path, &cells, self.columns(), self.size)
    }

    /// The values of the last axis stand in a row where there are several axes; else rows and columns are as many.
    fn columns(&self) -> usize {
        let varied: Vec<&Axis> = self.axes.iter().filter(|a| a.is_varied()).collect();
        match &varied[..] {
            [.., _, last] if !self.args.zip => last.values.len(),
            _ => (self.variants.len() as f64).sqrt().ceil() as usize,
        }
    }
}

impl Ran {
    fn wrong(why: &str) -> Self {
        let failure = Some(why.to_owned());
        Self { failure, wall: Duration::ZERO, tasks: 0, skipped: 0, numbers: BTreeMap::new(), pictures: Vec::new() }
    }

    fn new(graph: &Graph, outcome: &Outcome, seen: Seen, numbers: &[Port], (port, size): (Option<Port>, [usize; 2])) -> Self {
        let failure = (!outcome.is_complete()).then(|| outcome.diagnostics.first().map_or("cancelled".to_owned(), |d| d.message.clone()));
        let total = |f: fn(&pegbar_engine::exec::NodeStats) -> u64| outcome.report.stats.iter().map(f).sum();
        let mut pictures: Vec<Thumb> = seen.pictures.into_values().collect();
        if let (true, Some(port)) = (pictures.is_empty() && failure.is_none(), port) {
            // What was made in an earlier run and is not kept stands in the files that were written of it.
            pictures.extend(file_of(graph, port, outcome).and_then(|file| thumb_of_file(&file, size)));
        }
        let mut all = BTreeMap::new();
        for port in numbers {
            let Some(values) = seen.numbers.get(port).filter(|v| !v.is_empty()) else { continue };
            let name = graph.port_name(*port);
            if graph.is_single(*port) {
                all.extend(values.values().next().map(|v| (name, *v)));
                continue;
            }
            all.insert(format!("{name} mean"), values.values().sum::<f64>() / values.len() as f64);
            all.insert(format!("{name} max"), values.values().copied().fold(f64::NEG_INFINITY, f64::max));
        }
        Self { failure, wall: outcome.wall, tasks: total(|s| s.tasks), skipped: total(|s| s.skipped), numbers: all, pictures }
    }
}

fn cell(label: String, ran: &Ran) -> sheet::Cell<'_> {
    sheet::Cell { pictures: ran.pictures.iter().collect(), label, failure: ran.failure.as_deref() }
}

/// A line of a CSV file, as RFC 4180 has it.
fn row(cells: &[String]) -> String {
    let quoted = |cell: &String| {
        if cell.contains([',', '"', '\n']) { format!("\"{}\"", cell.replace('"', "\"\"")) } else { cell.clone() }
    };
    cells.iter().map(quoted).collect::<Vec<_>>().join(",")
}

fn written(path: &Path, result: Result<(), String>) -> Option<String> {
    result.err().map(|why| format!("{} cannot be written: {why}", path.display()))
}

/// How a variant is loaded.
fn options(args: &WedgeArgs, axes: &[Axis], variant: &Variant) -> LoadOptions {
    let of = |is_variable: bool| {
        let own = axes.iter().zip(&variant.picks).filter(move |(axis, _)| axis.is_variable == is_variable);
        own.map(|(axis, pick)| (axis.name.clone(), axis.values[*pick].clone())).collect()
    };
    LoadOptions { out: args.graph.out.join(&variant.folder), variables: of(true), overrides: of(false), ..args.graph.load_options() }
}

/// The output that the sheet shows: the one that is named, else the first picture that the graph declares, else the first that is written; of these one
/// that differs, where there is one.
fn picture(graph: &Graph, named: Option<&str>, differs: impl Fn(&Port) -> bool) -> Option<Port> {
    let is_picture = |port: &Port| graph.nodes[port.node].output_types.get(port.output).is_some_and(|ty| is_picture(ty));
    if let Some(name) = named {
        let declared = graph.outputs.iter().find(|(n, _)| n == name).map(|(_, port)| *port);
        let node = graph.find(name).map(|node| Port { node, output: 0 });
        let port = name.rsplit_once('.').and_then(|(node, port)| {
            let node = graph.find(node)?;
            Some(Port { node, output: graph.nodes[node].ty.schema.output(port)?.0 })
        });
        if let Some(port) = declared.or(node).or(port).filter(is_picture) {
            return Some(port);
        }
    }
    let written = graph.nodes.iter().filter(|n| n.written_paths().next().is_some()).flat_map(|n| &n.inputs);
    let written = written.filter_map(|binding| if let Binding::Wire(port) = binding { Some(*port) } else { None });
    let all: Vec<Port> = graph.outputs.iter().map(|(_, port)| *port).chain(written).filter(is_picture).collect();
    all.iter().find(|port| differs(port)).or(all.first()).copied()
}

/// The file in the middle of those that a sink writes of an output.
fn file_of(graph: &Graph, port: Port, outcome: &Outcome) -> Option<std::path::PathBuf> {
    let reads = |binding: &Binding| matches!(binding, Binding::Wire(p) if *p == port);
    let sink = graph.nodes.iter().find(|n| n.inputs.iter().any(reads) && n.written_paths().next().is_some())?;
    let paths: Vec<_> = sink.written_paths().collect();
    let own = |file: &&std::path::PathBuf| paths.iter().any(|p| sink.clock.frames().any(|f| p.at(f) == **file) || p.at(0) == **file);
    let files: Vec<_> = outcome.written.iter().filter(own).collect();
    files.get(files.len().saturating_sub(1) / 2).map(|f| (*f).clone())
}

#[cfg(test)]
mod tests;
