//! A plugin of every kind of input and setting, and of nodes that go wrong: what the SDK's tests load.
#![allow(clippy::panic, clippy::indexing_slicing, reason = "what becomes of it is what is tested")]

use pegbar_plugin::prelude::*;
use pegbar_plugin::value::{Curve, Vector};

/// Numbers in a buffer.
#[derive(Clone, Debug, Value)]
struct Numbers {
    /// The numbers.
    #[value(shape = "[n]")]
    numbers: Buffer<f64, 1>,
    /// A remark.
    #[value(text)]
    remark: String,
}

/// What all of them make.
#[derive(Outputs)]
pub struct One {
    /// What was made.
    value: Vector,
}

/// How numbers are joined.
#[derive(Clone, Debug, Setting)]
enum Join {
    /// Sum.
    Sum,
    /// Product.
    TheProduct,
}

/// Joins whatever stands at its inputs.
#[derive(Node)]
#[node(id = "sums.join", version = 1, outputs = One)]
pub struct SumsJoin {
    /// Several.
    several: List<In<Vector>>,
    /// One that may be left out.
    maybe: Option<In<Vector>>,
    /// A number that may be wired.
    #[input(default = 1.0)]
    factor: f64,
    /// How.
    #[input(default = sum)]
    how: Join,
    /// Numbers that are added.
    #[input(default = [])]
    more: Vec<[f64; 2]>,
    /// A limit, if there is one.
    limit: Option<u32>,
}

impl PerFrame for SumsJoin {
    fn run(self, cx: &Context) -> Result<One, NodeError> {
        let all = self.several.0.iter().chain(self.maybe.iter()).flat_map(|v| v.values.iter().copied());
        let all: Vec<f64> = all.chain(self.more.iter().flatten().copied()).collect();
        let joined: f64 = match self.how {
            Join::Sum => all.iter().sum(),
            Join::TheProduct => all.iter().product(),
        };
        let limited = self.limit.map_or(joined, |limit| joined.min(f64::from(limit)));
        Ok(One { value: Vector { values: vec![limited * self.factor, cx.clock.last as f64] } })
    }
}

/// One more than each number.
#[derive(Node)]
#[node(id = "sums.next", version = 1, outputs = One)]
pub struct SumsNext {
    /// The numbers.
    value: In<Vector>,
}

impl PerFrame for SumsNext {
    fn run(self, _cx: &Context) -> Result<One, NodeError> {
        Ok(One { value: Vector { values: self.value.values.iter().map(|n| n + 1.0).collect() } })
    }
}

/// Blends two rows of numbers.
#[derive(Node)]
#[node(id = "sums.blend", version = 1, outputs = One)]
pub struct SumsBlend {
    /// The one.
    one: In<Vector>,
    /// The other.
    other: In<Vector>,
    /// How much of the other.
    #[input(default = 0.5, range = 0.0..=1.0)]
    amount: f64,
    /// What is added.
    #[input(default = 0.0)]
    offset: f64,
    /// Numbers at the beginning that are left out.
    #[input(default = 0)]
    skip: usize,
    /// How they are joined before.
    #[input(default = sum)]
    how: Join,
}

impl PerFrame for SumsBlend {
    fn run(self, _cx: &Context) -> Result<One, NodeError> {
        let pairs = self.one.values.iter().zip(&self.other.values).skip(self.skip);
        let blend = |(a, b): (&f64, &f64)| match self.how {
            Join::Sum => a * (1.0 - self.amount) + b * self.amount + self.offset,
            Join::TheProduct => a * b + self.offset,
        };
        Ok(One { value: Vector { values: pairs.map(blend).collect() } })
    }
}

/// The sum of a window of frames.
#[derive(Node)]
#[node(id = "sums.window", version = 1, outputs = One)]
struct SumsWindow {
    /// The numbers.
    value: Frames<Curve>,
    /// Frames before.
    #[input(default = 1, range = 0..=10)]
    before: i64,
}

impl PerFrame for SumsWindow {
    fn reads(&self, input: &str, cx: &Context) -> Vec<i64> {
        let first = cx.input_clock(input).first;
        (first.max(cx.frame - self.before)..=cx.frame).collect()
    }

    fn run(self, cx: &Context) -> Result<One, NodeError> {
        let values = self.reads("value", cx).into_iter().map(|f| self.value.at(f).map(|v| v.value)).collect::<Result<_, _>>()?;
        Ok(One { value: Vector { values } })
    }
}

/// Makes numbers in the host's memory, with the address at which they lie.
#[derive(Node)]
#[node(id = "sums.make", version = 1, outputs = Made)]
struct SumsMake {
    /// How many.
    #[input(default = 3, range = 2..=1000)]
    count: usize,
}

/// What was made.
#[derive(Outputs)]
struct Made {
    /// The numbers.
    numbers: Numbers,
}

impl PerFrame for SumsMake {
    fn run(self, _cx: &Context) -> Result<Made, NodeError> {
        let mut numbers: Buffer<f64, 1> = Buffer::zeroed([self.count]).ok_or_else(|| NodeError::input("expected memory, found none"))?;
        numbers[0] = numbers.as_ptr().addr() as f64;
        numbers[1] = 1.5;
        Ok(Made { numbers: Numbers { numbers, remark: "made \"here\"".to_owned() } })
    }
}

/// Where numbers lie that were read, and what stands first in them.
#[derive(Node)]
#[node(id = "sums.look", version = 1, outputs = One)]
struct SumsLook {
    /// The numbers.
    numbers: In<Numbers>,
}

impl PerFrame for SumsLook {
    fn run(self, _cx: &Context) -> Result<One, NodeError> {
        let n = &self.numbers.numbers;
        Ok(One { value: Vector { values: vec![n.as_ptr().addr() as f64, n[0], n[1], self.numbers.remark.len() as f64] } })
    }
}

/// A running sum.
#[derive(Node)]
#[node(id = "sums.running", version = 1, kind = recurrent, outputs = One)]
struct SumsRunning {
    /// The numbers.
    value: In<Curve>,
}

/// The sum so far.
#[derive(Debug, Value)]
struct Sum {
    /// The sum.
    #[value(shape = "[]")]
    sum: f64,
}

impl Recurrent for SumsRunning {
    type State = Sum;

    fn run(self, state: Option<&Sum>, _cx: &Context) -> Result<(One, Sum), NodeError> {
        let sum = state.map_or(0.0, |s| s.sum) + self.value.value;
        Ok((One { value: Vector { values: vec![sum] } }, Sum { sum }))
    }
}

/// A running sum that begins anew every other frame, and reaches back two.
#[derive(Node)]
#[node(id = "sums.leaping", version = 1, kind = recurrent, outputs = One)]
struct SumsLeaping {
    /// The numbers.
    value: In<Curve>,
    /// Frames that it reaches back.
    #[input(default = 2, range = 1..=8)]
    leap: i64,
}

impl Recurrent for SumsLeaping {
    type State = Sum;

    fn previous(&self, cx: &Context) -> Option<i64> {
        (cx.frame - self.leap >= cx.clock.first).then(|| cx.frame - self.leap)
    }

    fn run(self, state: Option<&Sum>, _cx: &Context) -> Result<(One, Sum), NodeError> {
        let sum = state.map_or(0.0, |s| s.sum) + self.value.value;
        Ok((One { value: Vector { values: vec![sum] } }, Sum { sum }))
    }
}

/// The numbers of a shot the other way round.
#[derive(Node)]
#[node(id = "sums.back", version = 1, kind = whole, outputs = Back)]
struct SumsBack {
    /// The numbers.
    value: Sequence<Curve>,
}

/// What was turned.
#[derive(Outputs)]
struct Back {
    /// A number a frame.
    value: Stream<Curve>,
    /// How many there are.
    count: Curve,
}

impl Whole for SumsBack {
    fn run(self, cx: &Context) -> Result<Back, NodeError> {
        cx.check()?;
        let n = self.value.len();
        let value = (0..n).rev().map(|i| self.value.get(i).map(|v| Curve { value: v.value })).collect::<Result<_, _>>()?;
        Ok(Back { value: Stream(value), count: Curve { value: n as f64 } })
    }
}

/// The number of the frame.
#[derive(Node)]
#[node(id = "sums.frame", version = 1, outputs = Number, uses_frame)]
struct SumsFrame {}

/// A number.
#[derive(Outputs)]
struct Number {
    /// The number.
    value: Curve,
}

impl PerFrame for SumsFrame {
    fn run(self, cx: &Context) -> Result<Number, NodeError> {
        Ok(Number { value: Curve { value: cx.frame as f64 } })
    }
}

/// Goes wrong.
#[derive(Node)]
#[node(id = "sums.wrong", version = 1, outputs = One, uses_frame)]
struct SumsWrong {
    /// In which way.
    way: String,
}

impl PerFrame for SumsWrong {
    fn run(self, cx: &Context) -> Result<One, NodeError> {
        match self.way.as_str() {
            "panic" if cx.frame == 2 => panic!("frame {} is too much", cx.frame),
            "fail" if cx.frame == 2 => Err(NodeError::input("expected another frame, found this").help("leave it out")),
            _ => Ok(One { value: Vector { values: vec![] } }),
        }
    }
}

pegbar_plugin::export! {
    name: "sums",
    doc: "Numbers.",
    threads: instance,
    per_frame: [SumsBlend, SumsFrame, SumsJoin, SumsWindow, SumsMake, SumsLook, SumsNext, SumsWrong],
    recurrent: [SumsRunning, SumsLeaping],
    whole: [SumsBack],
    values: [Numbers],
}
