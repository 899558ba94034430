//! Several observers of one run.

use std::sync::Arc;

use pegbar_engine::exec::{Done, Failure, Observer, Results};
use pegbar_engine::graph::{Graph, Port};
use pegbar_engine::node::Meter;
use pegbar_engine::plan::Plan;
use pegbar_engine::value::ValueRef;

/// Tells each of these, in order.
pub(crate) struct Observers<'a>(pub(crate) Vec<&'a dyn Observer>);

impl Observer for Observers<'_> {
    fn planned(&self, graph: &Graph, plan: &Plan) {
        self.0.iter().for_each(|o| o.planned(graph, plan));
    }

    fn wanted(&self, graph: &Graph, plan: &Plan) {
        self.0.iter().for_each(|o| o.wanted(graph, plan));
    }

    fn made(&self, graph: &Graph, port: Port, frame: Option<i64>, value: &ValueRef) {
        self.0.iter().for_each(|o| o.made(graph, port, frame, value));
    }

    fn ended(&self, results: &Results) {
        self.0.iter().for_each(|o| o.ended(results));
    }

    fn started(&self, node: usize, frame: Option<i64>, thread: usize) {
        self.0.iter().for_each(|o| o.started(node, frame, thread));
    }

    fn meter(&self, thread: usize) -> Option<Arc<Meter>> {
        self.0.iter().find_map(|o| o.meter(thread))
    }

    fn done(&self, done: &Done) {
        self.0.iter().for_each(|o| o.done(done));
    }

    fn failed(&self, graph: &Graph, failure: &Failure) {
        self.0.iter().for_each(|o| o.failed(graph, failure));
    }

    fn keeps_inputs(&self) -> bool {
        self.0.iter().any(|o| o.keeps_inputs())
    }
}
