//! A plugin's node type as the executor knows it.

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use pegbar_abi::PB_STATE;

use super::call::{Feed, Made, MadeOf, Port, Request, Response, Settings, Transport};
use super::manifest::{Description, NodeText};
use super::settings::SettingData;
use crate::array::DType;
use crate::node::{Arg, Computed, Context, Fault, InputType, Kind, Needs, NodeError, NodeSchema, Operator, OutValue, PluginId, Problem};
use crate::setting::Setting;
use crate::value::{ValueRef, ValueType};

/// Settings that are remembered at once: more nodes of one type in one graph are made anew.
pub(super) const REMEMBERED: usize = 256;

/// What all node types of a plugin share.
pub(super) struct Plugin {
    pub(super) id: PluginId,
    pub(super) description: Description,
    pub(super) transport: Box<dyn Transport>,
}

pub(super) struct PluginOperator {
    pub(super) plugin: Arc<Plugin>,
    /// Position in the schema.
    pub(super) node: u32,
    pub(super) schema: Arc<NodeSchema>,
    /// The types of its outputs.
    pub(super) outputs: Vec<Option<ValueType>>,
    pub(super) state: Option<ValueType>,
    /// Names of the arrays that these have.
    pub(super) names: Vec<&'static str>,
    pub(super) known: Mutex<Vec<Arc<Settings>>>,
}

impl PluginOperator {
    fn text(&self) -> &NodeText {
        &self.plugin.description.nodes[self.node as usize]
    }

    fn broken(&self, why: String) -> NodeError {
        NodeError::new(Fault::Plugin, format!("plugin `{}` {}: {why}", self.plugin.id.name, self.plugin.id.version))
    }

    /// The settings among the arguments: those of earlier tasks, where they are the same.
    fn settings(&self, args: &[Arg]) -> Result<Arc<Settings>, NodeError> {
        let is_setting = |i: usize| matches!(self.schema.inputs.get(i).map(|s| &s.ty), Some(InputType::Setting { .. }));
        let literals = || {
            args.iter().enumerate().filter_map(move |(i, arg)| match arg {
                Arg::Literal(literal) if is_setting(i) => Some((i, literal)),
                _ => None,
            })
        };
        let is_same = |s: &Settings| {
            let mut known = s.literals.iter();
            literals().all(|(i, a)| known.next().is_some_and(|(j, b)| i == *j && Arc::ptr_eq(a, b))) && known.next().is_none()
        };
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(found) = known.iter().find(|s| is_same(s)) {
            return Ok(found.clone());
        }
        let item = |(i, literal): (usize, &crate::node::Literal)| {
            let data = SettingData::of(literal)
                .ok_or_else(|| self.broken(format!("input `{}`: a setting of another type", self.schema.inputs[i].name)))?;
            Ok((i as u32, data))
        };
        let items = literals().map(item).collect::<Result<_, NodeError>>()?;
        let literals = literals().map(|(i, l)| (i, l.clone())).collect();
        let made = Arc::new(Settings { items, literals, kept: OnceLock::new() });
        if known.len() >= REMEMBERED {
            known.remove(0);
        }
        known.push(made.clone());
        Ok(made)
    }

    fn ports(&self, args: Vec<Arg>, cx: &Context) -> Result<Vec<Port>, NodeError> {
        let mut ports = Vec::with_capacity(args.len());
        for (i, arg) in args.into_iter().enumerate() {
            let Some(schema) = self.schema.inputs.get(i) else { continue };
            let clock = cx.input_clocks.iter().find(|(name, _)| *name == schema.name).map(|(_, clock)| clock);
            match arg {
                Arg::List(args) => {
                    for arg in args {
                        self.port(i, arg, clock, &mut ports)?;
                    }
                }
                arg => self.port(i, arg, clock, &mut ports)?,
            }
        }
        Ok(ports)
    }

    fn port(&self, i: usize, arg: Arg, clock: Option<&Arc<crate::clock::Clock>>, ports: &mut Vec<Port>) -> Result<(), NodeError> {
        let is_setting = matches!(self.schema.inputs[i].ty, InputType::Setting { .. });
        let mut add = |feed, clock: Option<&Arc<crate::clock::Clock>>| ports.push(Port { input: i as u32, feed, clock: clock.cloned() });
        match arg {
            Arg::None => {}
            Arg::Literal(_) if is_setting => {}
            Arg::Literal(literal) => match literal.downcast_ref::<ValueRef>() {
                Some(value) => add(Feed::Value(value.clone()), clock),
                None => return Err(NodeError::internal("a literal of another type")),
            },
            Arg::Value(value) if is_setting => match f64::from_wire(value.as_ref()) {
                Some(number) => add(Feed::Number(number), clock),
                None => return Err(NodeError::internal(format!("expected a number, found {}", value.type_name()))),
            },
            Arg::Value(value) => add(Feed::Value(value), clock),
            Arg::Frames(values) => add(Feed::Frames(values), clock),
            Arg::Sequence(values) => {
                let clock = values.clock.clone();
                add(Feed::Sequence(values), clock.as_ref());
            }
            Arg::List(_) => return Err(NodeError::internal("a list within a list")),
        }
        Ok(())
    }

    /// The values that were made, held against what the node type declares.
    fn computed(&self, response: Response, cx: &Context) -> Result<Computed, NodeError> {
        // What is declared and what was made are both in the order of outputs and positions, the state last.
        let mut made = response.made.into_iter().peekable();
        let mut take = |output: u32, index: u64| made.next_if(|m| (m.output, m.index) == (output, index)).map(|m| m.what);
        let mut outputs = Vec::with_capacity(self.schema.outputs.len());
        for (p, (schema, ty)) in self.schema.outputs.iter().zip(&self.outputs).enumerate() {
            let ty = ty.as_ref();
            let mut one = |index: u64| {
                let at = || if schema.stream { format!(" at frame {}", cx.clock.first + index as i64) } else { String::new() };
                let value = self.value(take(p as u32, index), ty);
                let is_finite = self.text().outputs.get(p).is_some_and(|o| o.finite);
                value
                    .and_then(|value| if is_finite { finite(value) } else { Ok(value) })
                    .map_err(|why| self.broken(format!("output `{}`{}: {why}", schema.name, at())))
            };
            outputs.push(if schema.stream {
                OutValue::Stream((0..cx.clock.len() as u64).map(one).collect::<Result<_, _>>()?)
            } else {
                OutValue::One(one(0)?)
            });
        }
        let state = self.state.as_ref().map(|ty| self.value(take(PB_STATE, 0), Some(ty)));
        let state = state.transpose().map_err(|why| self.broken(format!("its state: {why}")))?;
        match made.next() {
            None => Ok(Computed { outputs, state }),
            Some(Made { output, index, .. }) => {
                Err(self.broken(format!("expected {}, found a value at {index} of output {output}", self.declared(cx))))
            }
        }
    }

    fn declared(&self, cx: &Context) -> String {
        let one = |o: &crate::node::OutputSchema| {
            if o.stream { format!("{} of `{}`", cx.clock.len(), o.name) } else { format!("one of `{}`", o.name) }
        };
        let all: Vec<String> = self.schema.outputs.iter().map(one).collect();
        if all.is_empty() { "no value".to_owned() } else { all.join(", ") }
    }

    fn value(&self, what: Option<MadeOf>, ty: Option<&ValueType>) -> Result<ValueRef, String> {
        let ty = ty.ok_or("expected a value type that is known, found another")?;
        match what {
            Some(MadeOf::Parts(parts)) => {
                let known = |name: &str| ty.schema.arrays.iter().any(|a| a.name == name);
                if let Some((strange, _)) = parts.arrays.iter().find(|(name, _)| !known(name)) {
                    return Err(format!("expected the arrays of {}, found `{strange}`", ty.schema.name));
                }
                (ty.from_parts)(parts).map_err(|e| e.to_string())
            }
            Some(MadeOf::Passed(value)) if value.type_name() == ty.schema.name => Ok(value),
            Some(MadeOf::Passed(value)) => Err(format!("expected {}, found {}", ty.schema.name, value.type_name())),
            None => Err(format!("expected {}, found none", ty.schema.name)),
        }
    }

    fn request<R>(
        &self,
        args: Vec<Arg>,
        state: Option<ValueRef>,
        cx: &Context,
        run: impl FnOnce(&Request) -> Result<R, NodeError>,
    ) -> Result<R, NodeError> {
        let settings = self.settings(&args)?;
        let ports = self.ports(args, cx)?;
        let request = Request {
            node: self.node,
            settings: &settings,
            frame: cx.frame,
            clock: cx.clock,
            ports,
            state,
            cancel: cx.cancel,
            names: &self.names,
        };
        run(&request)
    }

    /// The frames of a window that is said in words.
    fn window(&self, input: &str, args: &[Arg], cx: &Context) -> Option<Vec<i64>> {
        let (from, to) = self.text().inputs.iter().find(|i| i.name == input)?.window.as_ref()?;
        let end = |text: &str| {
            let (sign, name) = text.strip_prefix('-').map_or((1, text), |name| (-1, name));
            let setting = |name: &str| match args.get(self.schema.input(name)?.0)? {
                Arg::Literal(literal) => SettingData::of(literal)?.wholes.first().copied(),
                _ => None,
            };
            name.parse::<i64>().ok().or_else(|| setting(name)).map(|n| sign * n)
        };
        let clock = cx.input_clock(input);
        let reach = clock.len() as i64;
        let (from, to) = (end(from)?.clamp(-reach, reach), end(to)?.clamp(-reach, reach));
        let mut frames: Vec<i64> = (from..=to).map(|offset| clock.clamp(cx.frame + offset)).collect();
        frames.dedup();
        Some(frames)
    }
}

/// The value, where all of its numbers are finite.
fn finite(value: ValueRef) -> Result<ValueRef, String> {
    for (name, view) in value.parts().arrays {
        let strange = match view.dtype {
            DType::F32 => bytemuck::cast_slice::<_, f32>(view.bytes).iter().position(|n| !n.is_finite()),
            DType::F64 => bytemuck::cast_slice::<_, f64>(view.bytes).iter().position(|n| !n.is_finite()),
            DType::I64 | DType::U32 | DType::U8 => None,
        };
        if let Some(at) = strange {
            return Err(format!("array `{name}`: expected finite numbers, found {} as number {at}", view.numbers()[at]));
        }
    }
    Ok(value)
}

impl Operator for PluginOperator {
    fn plugin(&self) -> Option<&PluginId> {
        Some(&self.plugin.id)
    }

    fn state_type(&self) -> Option<ValueType> {
        self.state.clone()
    }

    fn needs(&self, args: Vec<Arg>, inputs: &[&'static str], cx: &Context) -> Result<Needs, NodeError> {
        let is_recurrent = self.schema.kind == Kind::Recurrent;
        if !self.text().asks {
            let frames = inputs.iter().map(|input| self.window(input, &args, cx).unwrap_or_else(|| vec![cx.frame])).collect();
            let previous = (is_recurrent && cx.frame > cx.clock.first).then(|| cx.frame - 1);
            return Ok(Needs { frames, previous });
        }
        let windows: Vec<_> = inputs.iter().map(|input| self.window(input, &args, cx)).collect();
        let answer = self.request(args, None, cx, |request| self.plugin.transport.needs(request))?;
        let asked = |(input, window): (&&'static str, Option<Vec<i64>>)| {
            let at = self.schema.input(input).map(|(i, _)| i as u32);
            window.unwrap_or_else(|| answer.needs.iter().filter(|(i, _)| Some(*i) == at).map(|(_, frame)| *frame).collect())
        };
        Ok(Needs { frames: inputs.iter().zip(windows).map(asked).collect(), previous: answer.previous.filter(|_| is_recurrent) })
    }

    fn asked_previous(&self, args: Vec<Arg>, cx: &Context) -> Option<(bool, Result<Option<i64>, NodeError>)> {
        let answer = self.request(args, None, cx, |request| self.plugin.transport.needs(request));
        Some((self.text().asks, answer.map(|answer| answer.previous)))
    }

    fn compute(&self, args: Vec<Arg>, state: Option<ValueRef>, cx: &Context) -> Result<Computed, NodeError> {
        let response = self.request(args, state, cx, |request| self.plugin.transport.compute(request))?;
        self.computed(response, cx)
    }

    /// Its code is not asked, so that checking loads none.
    fn check(&self, _args: Vec<Arg>) -> Result<Vec<Problem>, NodeError> {
        Ok(Vec::new())
    }
}
