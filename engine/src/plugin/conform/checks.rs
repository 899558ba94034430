//! The checks that run code: what must hold of any node, held against one.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::guard::{GUARDS, in_use};
use super::literals::extremes;
use super::make::{Kind, Sizes};
use super::probe::{Setup, Subject, answered, clock};
use super::{Checked, Stop};
use crate::node::{self, Arg, Cancel, Computed, Context, InputType, NodeError, OutValue};
use crate::plugin::operator::REMEMBERED;
use crate::plugin::shown::with_wide_rows;
use crate::value::{self, ValueRef};

/// Threads that call at once.
const THREADS: usize = 8;
/// How long a check that repeats itself does so.
const PATIENCE: Duration = Duration::from_secs(2);

/// The digests of all that was made.
fn bits(computed: &Computed) -> Vec<String> {
    let values = computed.outputs.iter().flat_map(|out| match out {
        OutValue::One(value) => std::slice::from_ref(value),
        OutValue::Stream(values) => values,
    });
    values.chain(&computed.state).map(|v| value::digest(v.as_ref()).to_hex().to_string()).collect()
}

/// As [`bits`], or what was said instead.
fn bits_or(done: Result<Computed, NodeError>) -> Vec<String> {
    done.as_ref().map_or_else(|error| vec![error.message.clone()], bits)
}

/// In what two tasks differ, in words.
fn differing(schema: &node::NodeSchema, a: &[String], b: &[String]) -> Option<String> {
    let at = (0..a.len().max(b.len())).find(|&i| a.get(i) != b.get(i))?;
    // Streams have one a frame, which no name tells apart.
    let name = if schema.outputs.iter().any(|o| o.stream) { None } else { Some(schema.outputs.get(at).map_or("its state", |o| o.name)) };
    Some(name.map_or("its output".to_owned(), |n| format!("`{n}`")))
}

impl Subject<'_> {
    pub(super) fn ordinary(&self) -> Checked {
        let values: Vec<&str> = self.ports().map(|(_, ty)| ty).collect();
        let setup = self.usual(true)?;
        if let Some(ty) = values.into_iter().find(|ty| self.value(&setup, 0, ty, 1).is_none()) {
            return Err(Stop::not_tried(format!("expected a value of {ty} to try it with, found none that the type takes")));
        }
        let good = self.good()?;
        // What may be left out is left out once.
        self.run_all(&Setup { full: !good.full, ..good }, "ordinary values, optional inputs left out or not").map(drop)
    }

    pub(super) fn settings(&self) -> Checked {
        let good = self.good()?;
        for (i, input) in self.inputs().iter().enumerate() {
            let InputType::Setting { name, wire } = &input.ty else { continue };
            for text in extremes(name, input) {
                let Ok(literal) = self.parse(input, &text) else { continue };
                let mut setup = Setup { clock: clock(1, 2, (24, 1)), ..good.clone() };
                setup.literals[i] = Some(literal);
                self.run_all(&setup, &format!("`{}` = {text}", input.name))?;
            }
            let range = input.range.unwrap_or((-1e3, 1e3));
            for number in [range.0.max(-1e6), range.1.min(1e6), f64::NAN, f64::INFINITY].into_iter().filter(|_| wire.is_some()) {
                let mut setup = Setup { clock: clock(1, 2, (24, 1)), wired: Some((i, number)), ..good.clone() };
                setup.literals[i] = None;
                self.run_all(&setup, &format!("`{}` wired to {number}", input.name))?;
            }
        }
        Ok(())
    }

    pub(super) fn sizes(&self) -> Checked {
        let good = self.good()?;
        let sizes = [
            (1, 1, 4, 1),
            (1, 13, 4, 2),
            (13, 1, 4, 3),
            (7, 5, 1, 5),
            (17, 11, 3, 7),
            (31, 3, 2, 13),
            (5, 7, 5, 17),
            (0, 0, 4, 0),
            (0, 7, 3, 0),
            (7, 0, 3, 0),
            (3, 3, 0, 3),
        ];
        for (height, width, channels, points) in sizes {
            let sizes = Sizes { height, width, channels, points, ..Sizes::ORDINARY };
            let named = format!("values of {height}x{width}x{channels}, {points} points");
            let setup = Setup { sizes, clock: clock(1, 2, (24, 1)), ..good.clone() };
            self.run_all(&setup, &named)?;
            if GUARDS {
                self.run_all(&Setup { guarded: true, ..setup.clone() }, &format!("{named}, read-only, nothing behind them"))?;
            }
            // A state of one size meets pictures of another.
            if let (Some(Ok(before)), Some(args)) = (self.run_all(&good, "ordinary values")?.pop(), self.args(&setup, 2)?)
                && before.state.is_some()
            {
                let at = self.say(format!("{named}, after others of {}x{}", good.sizes.height, good.sizes.width));
                answered(self.compute(&setup, args, 2, before.state), &at)?.ok();
            }
        }
        Ok(())
    }

    pub(super) fn rows(&self) -> Checked {
        let good = Setup { full: true, ..self.good()? };
        let usual: Vec<_> = self.run_all(&good, "ordinary values")?.into_iter().map(bits_or).collect();
        // With settings in such rows, too.
        let own = Self::new(self.probe, self.node.schema.id, self.say)?;
        let at = self.say("rows of structs with 16 bytes more each, as a later version of the ABI may have".to_owned());
        let wide = with_wide_rows(|| own.run_all(&good, "rows of larger structs"))?;
        let wide: Vec<_> = wide.into_iter().map(bits_or).collect();
        if usual == wide {
            return Ok(());
        }
        let help =
            "the next struct of a row is `struct_size` bytes behind (PB_AT, pb_port, pb_array), whatever this header says of its size";
        Err(Stop::failed(format!("{at}: expected the same bits, found others")).help(help))
    }

    pub(super) fn values(&self) -> Checked {
        let good = self.good()?;
        let ports: Vec<usize> = self.ports().map(|(i, _)| i).collect();
        for kind in Kind::WRONG {
            for at in ports.iter().map(|i| Some(*i)).chain((ports.len() > 1).then_some(None)) {
                let setup = Setup { kind, sizes: kind.sizes(), at, clock: clock(1, 2, (24, 1)), ..good.clone() };
                let place = at.map_or("every input".to_owned(), |i| format!("`{}`", self.inputs()[i].name));
                self.run_all(&setup, &format!("{} at {place}", kind.words()))?;
            }
        }
        Ok(())
    }

    pub(super) fn frames(&self) -> Checked {
        let good = self.good()?;
        for (first, last, fps) in
            [(1, 1, (24, 1)), (-3, 0, (24, 1)), (1001, 1003, (24_000, 1001)), (i64::from(i32::MAX), i64::from(i32::MAX), (1, 1))]
        {
            let setup = Setup { clock: clock(first, last, fps), ..good.clone() };
            self.run_all(&setup, &format!("frames {first} to {last} at {}/{} a second", fps.0, fps.1))?;
        }
        self.states(&good)?;
        self.run_all(&Setup { still: true, ..good.clone() }, "single values in place of streams")?;
        self.run_all(&Setup { empty: true, ..good }, "sequences and lists of nothing").map(drop)
    }

    /// Which state a node starts from: that of the frame before, unless it says that it is asked.
    fn states(&self, good: &Setup) -> Checked {
        if self.node.schema.kind != node::Kind::Recurrent {
            return Ok(());
        }
        let setup = Setup { clock: clock(1, 6, (24, 1)), ..good.clone() };
        let input_clocks = &self.input_clocks(&setup);
        let mut answered = 0;
        for frame in setup.clock.first + 1..=setup.clock.last {
            let Some(args) = self.args(&setup, frame)? else { continue };
            let at = self.say(format!("frame {frame}, asked which state it starts from"));
            let cx = Context { frame, clock: &setup.clock, input_clocks, cancel: &setup.cancel };
            let Some((asks, Ok(previous))) = self.node.operator.asked_previous(args, &cx) else { continue };
            let found = match previous {
                Some(previous) if previous >= frame || previous < setup.clock.first => {
                    format!("{at}: expected a frame from {} to {}, found {previous}", setup.clock.first, frame - 1)
                }
                Some(previous) if !asks && previous != frame - 1 => {
                    format!("{at}: expected that of frame {}, as it does not say `asks: true`, found that of {previous}", frame - 1)
                }
                None if !asks && answered > 0 => {
                    format!("{at}: expected that of frame {}, as it does not say `asks: true`, found none", frame - 1)
                }
                Some(_) => {
                    answered += 1;
                    continue;
                }
                None => continue,
            };
            let help = "a node that does not start from the frame before says `asks: true` in its schema; else it is never asked";
            return Err(Stop::failed(found).help(help));
        }
        Ok(())
    }

    pub(super) fn same(&self) -> Checked {
        let good = self.good()?;
        let schema = &self.node.schema;
        let differ = |a: &[String], b: &[String], what: String, help: &str| match differing(schema, a, b) {
            Some(which) => Err(Stop::failed(format!("{what}: expected the same bits, found others in {which}")).help(help)),
            None => Ok(()),
        };
        let first = self.again(&good)?;
        let stale = "a node may look at its input, its settings and its frame alone: at no clock, no random seed, nothing that it kept from another task";
        // Backwards, and once more with an instance of its own.
        let other = Self::new(self.probe, schema.id, self.say)?;
        for (subject, what) in [(self, "again, backwards"), (&other, "with a new instance, backwards")] {
            for (i, frame) in self.frames_of(&good).into_iter().enumerate().rev() {
                let state = if i > 0 { first[i - 1].state.clone() } else { None };
                let Some(args) = self.args(&good, frame)? else { continue };
                let at = self.say(format!("frame {frame} {what}"));
                differ(&bits(&first[i]), &bits_or(subject.compute(&good, args, frame, state)), at, stale)?;
            }
        }
        let reads_frame = schema.uses_frame || schema.kind == node::Kind::Recurrent || schema.kind == node::Kind::Whole;
        if reads_frame || self.inputs().iter().any(|i| i.access.asks()) {
            return Ok(());
        }
        let still = self.run_all(&Setup { still: true, ..good.clone() }, "the same values at every frame")?;
        let bits: Vec<Vec<String>> = still.into_iter().map(bits_or).collect();
        let help = "a node whose output differs from frame to frame whatever its inputs says `uses_frame: true`; else the first frame stands for all";
        bits.windows(2).try_for_each(|pair| differ(&pair[0], &pair[1], "the same input at two frames".to_owned(), help))
    }

    pub(super) fn threads(&self) -> Checked {
        let good = self.good()?;
        let done = self.again(&good)?;
        let mut tasks = Vec::new();
        for (i, frame) in self.frames_of(&good).into_iter().enumerate() {
            let state = if i > 0 { done[i - 1].state.clone() } else { None };
            let Some(args) = self.args(&good, frame)? else { continue };
            tasks.push((frame, args, state, bits(&done[i])));
        }
        let at = self.say(format!("{THREADS} threads at once"));
        let (started, setup, schema, tasks, operator) = (Instant::now(), &good, &self.node.schema, &tasks, &self.node.operator);
        let input_clocks = &self.input_clocks(&good);
        let one = |thread: usize| {
            for round in 0..50 {
                let (frame, args, state, expected) = &tasks[(thread + round) % tasks.len()];
                let cx = Context { frame: *frame, clock: &setup.clock, input_clocks, cancel: &setup.cancel };
                let found = bits_or(operator.compute(args.clone(), state.clone(), &cx));
                if let Some(which) = differing(schema, expected, &found) {
                    return Some(format!("{at}, frame {frame}: expected the bits that one thread makes, found others in {which}"));
                }
                if started.elapsed() > PATIENCE {
                    break;
                }
            }
            None
        };
        let wrong = std::thread::scope(|scope| {
            let threads: Vec<_> = (0..THREADS).map(|thread| scope.spawn(move || one(thread))).collect();
            threads.into_iter().find_map(|thread| thread.join().ok().flatten())
        });
        let help = "what tasks share must not be written while they run; or say `threads: instance` or `threads: one` in the schema";
        wrong.map_or(Ok(()), |wrong| Err(Stop::failed(wrong).help(help)))
    }

    pub(super) fn untouched(&self) -> Checked {
        let good = self.good()?;
        let mut state: Option<ValueRef> = None;
        for frame in self.frames_of(&good) {
            let Some(args) = self.args(&good, frame)? else { continue };
            let digests = || (digests(&args), state.as_ref().map(|s| value::digest(s.as_ref())));
            let before = digests();
            self.say(format!("frame {frame}"));
            let done = self.compute(&good, args.clone(), frame, state.clone());
            if digests() != before {
                let why = format!("frame {frame}: expected its inputs to stay as they are, found them written to");
                return Err(Stop::failed(why).help("other nodes read the same values: write to what `array` or `alloc` gives"));
            }
            state = done.ok().and_then(|c| c.state);
        }
        drop(state);
        if !GUARDS {
            return Ok(());
        }
        // What is dropped here nobody may touch again.
        let own = Self::new(self.probe, self.node.schema.id, self.say)?;
        let setup = Setup { guarded: true, ..good };
        own.run_all(&setup, "inputs that may only be read")?;
        own.run_all(&setup, "after the inputs of earlier tasks were taken away (a value is kept with `hold`)")?;
        self.say("ending the instance after its inputs were taken away (a value is kept with `hold`)");
        drop(own);
        Ok(())
    }

    pub(super) fn leaks(&self) -> Checked {
        let good = self.good()?;
        self.held(&good)?;
        for kind in [Kind::Ordinary, Kind::Empty, Kind::Nan] {
            let setup = Setup { kind, sizes: kind.sizes(), ..good.clone() };
            let first = self.frames_of(&setup)[0];
            let Some(args) = self.args(&setup, first)? else { continue };
            self.grows(&format!("a task with {}", kind.words()), 0, &|| drop(self.compute(&setup, args.clone(), first, None)))?;
        }
        self.grows("a new instance", 2 * REMEMBERED as u64, &|| {
            let (setup, first) = (self.usual(good.full), good.clock.first);
            if let Ok(setup) = setup
                && let Ok(Some(args)) = self.args(&setup, first)
            {
                drop(self.compute(&setup, args, first, None));
            }
        })
    }

    /// Values that are kept beyond the instance that they were given to.
    fn held(&self, good: &Setup) -> Checked {
        const CALLS: i64 = 64;
        let own = Self::new(self.probe, self.node.schema.id, self.say)?;
        let mut given: Vec<ValueRef> = Vec::new();
        let mut rows = Vec::new();
        for call in 0..CALLS {
            let frame = good.clock.first + call % good.clock.len() as i64;
            rows.extend(own.args(good, frame)?.filter(|_| self.node.schema.kind != node::Kind::Whole || call < 8));
        }
        for (i, args) in rows.into_iter().enumerate() {
            each_value(&args, &mut |value| given.push(value.clone()));
            let frame = good.clock.first + i as i64 % good.clock.len() as i64;
            own.say(format!("task {i}"));
            drop(own.compute(good, args, frame, None));
        }
        drop(own);
        let kept = given.iter().filter(|value| Arc::strong_count(value) > 1).count();
        if kept * 2 > given.len() {
            let why = format!("expected the values that it was given to be let go of, found {kept} of {} kept", given.len());
            return Err(Stop::failed(why).help("`release` once for each `hold` and each `fetch`, at the latest in `destroy`"));
        }
        Ok(())
    }

    /// Whether memory grows each time that something is done.
    fn grows(&self, what: &str, warm: u64, work: &dyn Fn()) -> Checked {
        self.say(what);
        let Some(_) = in_use() else { return Ok(()) };
        let started = Instant::now();
        work();
        let each = started.elapsed().max(Duration::from_nanos(100));
        if each * warm as u32 > PATIENCE * 5 {
            return Ok(());
        }
        let calls = (PATIENCE.as_nanos() / each.as_nanos() / 8).clamp(8, 300) as u64;
        let batch = || {
            let before = in_use().unwrap_or_default();
            (0..calls).for_each(|_| work());
            in_use().unwrap_or_default().saturating_sub(before)
        };
        // What is made once is made in the first of them, and as much kept as is kept at all.
        (0..calls.max(warm)).for_each(|_| work());
        batch();
        let grown: Vec<u64> = (0..3).map(|_| batch()).collect();
        match grown.iter().min() {
            // The smallest piece that can be had is larger.
            Some(&least) if least >= calls * 8 => {
                let why = format!("{what}: expected memory to be given back, found {} bytes more each time", least / calls);
                Err(Stop::failed(why)
                    .help("free what `create` and `compute` take, where they fail, too; and blocks of `alloc` that are not put"))
            }
            _ => Ok(()),
        }
    }

    pub(super) fn cancel(&self) -> Checked {
        let good = self.good()?;
        let cancel = Cancel::default();
        cancel.cancel();
        let sizes = Sizes { height: 720, width: 1280, points: 20_000, ..Sizes::ORDINARY };
        let setup = Setup { sizes, cancel, clock: clock(1, 1, (24, 1)), ..good };
        let Some(args) = self.args(&setup, 1)? else { return Ok(()) };
        let at = self.say("a task of 1280x720, 20000 points, that is to stop".to_owned());
        let started = Instant::now();
        let done = self.compute(&setup, args, 1, None);
        let took = started.elapsed();
        match done {
            Err(error) if error.cancelled => Ok(()),
            done if took < Duration::from_secs(1) => answered(done, &at).map(drop),
            _ => {
                let why = format!("{at}: expected it to stop within a second, found that it went on for {:.1} s", took.as_secs_f64());
                Err(Stop::failed(why).help("ask `is_cancelled` once a row or so, and return PB_CANCELLED; in Rust `cx.check()?`"))
            }
        }
    }
}

fn each_value(args: &[Arg], each: &mut dyn FnMut(&ValueRef)) {
    for arg in args {
        match arg {
            Arg::Value(value) => each(value),
            Arg::Frames(values) => values.iter().for_each(|(_, value)| each(value)),
            Arg::Sequence(sequence) => (0..sequence.len()).filter_map(|i| sequence.get(i).ok()).for_each(|value| each(&value)),
            Arg::List(args) => each_value(args, each),
            Arg::None | Arg::Literal(_) => {}
        }
    }
}

fn digests(args: &[Arg]) -> Vec<blake3::Hash> {
    let mut digests = Vec::new();
    each_value(args, &mut |value| digests.push(value::digest(value.as_ref())));
    digests
}
