//! Placement of values in buffers.

use edgecap_kernels::Layout;

use super::lifetime::{self, Lifetime};
use crate::engine::network::{Graph, Node, Op, ValueId};

/// A network whose values cannot be placed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct PlanError(String);

impl PlanError {
    fn order(found: impl std::fmt::Display) -> Self {
        Self(format!(
            "{found}; change the order or the concatenations in the network file"
        ))
    }

    /// A value that a layer joins, and that already lies beside others than the layer wants.
    fn shared(graph: &Graph, value: ValueId, layer: &str) -> Self {
        let called = graph.layers.iter().find(|(_, v)| **v == value);
        let called = called.map_or(&graph.values[value].name, |(name, _)| name);
        let found = format!(
            "layer `{layer}` joins `{called}`, which another join has put elsewhere in memory"
        );
        if value == Graph::INPUT {
            return Self(format!(
                "{found}; join the picture in one layer only, and in this one a convolution of it"
            ));
        }
        if !graph.layers.contains_key(called) {
            return Self::order(found);
        }
        let is_free = |name: &String| {
            !graph.layers.contains_key(name) && graph.nodes.iter().all(|n| n.name != *name)
        };
        let numbered = (2..).map(|n| format!("{called}.copy{n}"));
        let mut names = std::iter::once(format!("{called}.copy")).chain(numbered);
        let copy = names.find(is_free).unwrap_or_default();
        Self(format!(
            "{found}; let it join a copy: {{ kind = \"maxpool\", name = \"{copy}\", from = [\"{called}\"], kernel = 1, \
             stride = 1 }}"
        ))
    }

    /// Inputs of a layer that lie side by side and are of other (height, width) than the first.
    fn joined(
        layer: &str,
        (first, at): (&str, (usize, usize)),
        (other, found): (&str, (usize, usize)),
    ) -> Self {
        Self(format!(
            "layer `{layer}` joins `{first}` of {}x{} and `{other}` of {}x{}, expected one size; correct the strides in \
             the network file, or choose another input size",
            at.1, at.0, found.1, found.0
        ))
    }

    fn size(value: &str, found: impl std::fmt::Display) -> Self {
        Self(format!(
            "value `{value}`: {found}; choose another input size or correct the network file"
        ))
    }
}

/// A buffer of the engine's arena.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Slot {
    /// The whole buffer as a tensor, indices relative to `base`.
    pub layout: Layout,
    /// Its first element in the arena.
    pub base: usize,
    /// Values that live in it and their first channel.
    pub tenants: Vec<(ValueId, usize)>,
}

/// A buffer whose channels and halo still grow.
struct Draft {
    height: usize,
    width: usize,
    channels: usize,
    halo: usize,
    tenants: Vec<(ValueId, usize)>,
}

/// Where a tensor lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Place {
    /// In a slot; layout relative to the slot's base.
    Slot { slot: usize, layout: Layout },
    /// In an output map.
    Output { index: usize, layout: Layout },
}

/// Every value's place.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Plan {
    pub slots: Vec<Slot>,
    /// Elements of the arena, a multiple of [`Plan::ALIGN`].
    pub len: usize,
    /// Place of every value.
    pub values: Vec<Place>,
    /// (height, width) of every value.
    pub sizes: Vec<(usize, usize)>,
}

/// What a value asks of its buffer; values with different needs never share one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Needs {
    size: (usize, usize),
    /// What the halo must hold; shared slots must agree.
    padding: u8,
}

impl Plan {
    /// Slots begin at multiples of this many elements (a cache line of bytes).
    pub const ALIGN: usize = 64;
    /// Most bytes of the arena: what is larger is a mistake in a network file, not a network for a CPU.
    const MAX_BYTES: usize = 1 << 30;

    /// Places every value of `graph` for an input of `height` × `width`, in elements of so many bytes. `padding` is the
    /// stored number of real 0 of a value.
    ///
    /// # Errors
    /// When the network's order does not allow it, or the buffers take more than 1 GiB together.
    pub fn new(
        graph: &Graph,
        height: usize,
        width: usize,
        element: usize,
        padding: impl Fn(ValueId) -> u8,
    ) -> Result<Self, PlanError> {
        let sizes = graph.sizes(height, width);
        let mut b = Builder {
            graph,
            lives: lifetime::of(graph),
            halos: halos(graph),
            needs: sizes
                .iter()
                .enumerate()
                .map(|(v, &size)| Needs {
                    size,
                    padding: padding(v),
                })
                .collect(),
            slots: Vec::new(),
            at: vec![None; graph.values.len()],
        };
        for node in graph.nodes.iter().filter(|n| n.inputs.len() > 1) {
            b.concatenate(node)?;
        }
        for v in 0..graph.values.len() {
            if b.at[v].is_none() && b.output(v).is_none() {
                b.single(v);
            }
        }
        let Builder {
            slots: drafts, at, ..
        } = b;
        let mut len = 0;
        let mut slots = Vec::with_capacity(drafts.len());
        for d in drafts {
            let name = &graph.values[d.tenants[0].0].name;
            let layout = Layout::dense(d.height, d.width, d.channels, d.halo)
                .map_err(|e| PlanError::size(name, e))?;
            slots.push(Slot {
                layout,
                base: len,
                tenants: d.tenants,
            });
            len += layout.buffer_len().next_multiple_of(Self::ALIGN);
            if len > Self::MAX_BYTES / element {
                let found = format!("buffers of more than {} MB", Self::MAX_BYTES / 1_000_000);
                return Err(PlanError::size(name, found));
            }
        }
        let place = |v: ValueId| match at[v] {
            Some((slot, first)) => Ok(Place::Slot {
                slot,
                layout: slots[slot]
                    .layout
                    .channel_slice(first, graph.values[v].channels),
            }),
            None => {
                let index = graph.outputs.iter().position(|(_, o)| *o == v);
                let value = &graph.values[v];
                Ok(Place::Output {
                    index: index.unwrap_or_else(|| unreachable!("value {v} was not placed")),
                    layout: Layout::dense(sizes[v].0, sizes[v].1, value.channels, 0)
                        .map_err(|e| PlanError::size(&value.name, e))?,
                })
            }
        };
        let values = (0..graph.values.len())
            .map(place)
            .collect::<Result<_, PlanError>>()?;
        let plan = Self {
            values,
            slots,
            len,
            sizes,
        };
        plan.prove(graph)?;
        Ok(plan)
    }

    /// Shows what the runner relies on: while a value is alive nobody else writes its elements, and concatenated values
    /// are neighbours in order. Cheap beside packing weights, so it is done for every plan, not only in tests.
    fn prove(&self, graph: &Graph) -> Result<(), PlanError> {
        let lives = lifetime::of(graph);
        for a in 0..graph.values.len() {
            for b in 0..a {
                let (Some(x), Some(y)) = (self.occupied(a), self.occupied(b)) else {
                    continue;
                };
                let apart = x.0 != y.0 || x.2 <= y.1 || y.2 <= x.1;
                if !apart && lives[a].overlaps(lives[b]) {
                    return Err(PlanError::order(format!(
                        "values `{}` and `{}` would overwrite each other",
                        graph.values[a].name, graph.values[b].name
                    )));
                }
            }
        }
        for node in graph.nodes.iter().filter(|n| n.inputs.len() > 1) {
            for pair in node.inputs.windows(2) {
                let (x, y) = (self.occupied(pair[0]), self.occupied(pair[1]));
                if x.is_none() || x.map(|x| (x.0, x.2)) != y.map(|y| (y.0, y.1)) {
                    return Err(PlanError::order(format!(
                        "the inputs of `{}` are not neighbours",
                        node.name
                    )));
                }
            }
        }
        Ok(())
    }

    /// Slot and channels `first..end` that a value occupies in it.
    fn occupied(&self, v: ValueId) -> Option<(usize, usize, usize)> {
        match self.values[v] {
            Place::Slot { slot, layout } => {
                let first = layout.origin() - self.slots[slot].layout.origin();
                Some((slot, first, first + layout.channels()))
            }
            Place::Output { .. } => None,
        }
    }

    /// The place of a node's input: one value, or neighbours in one slot seen as one tensor.
    pub fn input(&self, graph: &Graph, node: &Node) -> Place {
        let first = self.values[node.inputs[0]];
        match first {
            Place::Slot { slot, layout } => {
                let whole = self.slots[slot].layout;
                let channels = node.inputs.iter().map(|&v| graph.values[v].channels).sum();
                Place::Slot {
                    slot,
                    layout: whole.channel_slice(layout.origin() - whole.origin(), channels),
                }
            }
            Place::Output { .. } => first,
        }
    }
}

/// The halo that each value's consumers read.
fn halos(graph: &Graph) -> Vec<usize> {
    let mut halos = vec![0; graph.values.len()];
    for node in &graph.nodes {
        let halo = match &node.op {
            Op::Conv { shape, .. } => shape.input_halo(),
            Op::MaxPool { shape } => shape.padding(),
        };
        for &v in &node.inputs {
            halos[v] = halos[v].max(halo);
        }
    }
    halos
}

struct Builder<'a> {
    graph: &'a Graph,
    lives: Vec<Lifetime>,
    halos: Vec<usize>,
    needs: Vec<Needs>,
    slots: Vec<Draft>,
    /// Slot and first channel.
    at: Vec<Option<(usize, usize)>>,
}

impl Builder<'_> {
    /// The map that a value is, if it is an output: no operation reads those.
    fn output(&self, v: ValueId) -> Option<usize> {
        self.graph.outputs.iter().position(|(_, o)| *o == v)
    }

    fn channels(&self, v: ValueId) -> usize {
        self.graph.values[v].channels
    }

    /// Whether `v` can live at `first..` of `slot` without disturbing its tenants.
    fn fits(&self, v: ValueId, slot: usize, first: usize) -> bool {
        let end = first + self.channels(v);
        self.slots[slot].tenants.iter().all(|&(t, at)| {
            let apart = end <= at || at + self.channels(t) <= first;
            apart
                || (!self.lives[v].overlaps(self.lives[t])
                    && self.needs[v].padding == self.needs[t].padding)
        })
    }

    fn settle(&mut self, v: ValueId, slot: usize, first: usize) {
        if self.at[v] == Some((slot, first)) {
            return;
        }
        let end = first + self.channels(v);
        let halo = self.halos[v];
        let s = &mut self.slots[slot];
        s.channels = s.channels.max(end);
        s.halo = s.halo.max(halo);
        s.tenants.push((v, first));
        self.at[v] = Some((slot, first));
    }

    fn new_slot(&mut self, v: ValueId) -> usize {
        let (height, width) = self.needs[v].size;
        self.slots.push(Draft {
            height,
            width,
            channels: 0,
            halo: 0,
            tenants: Vec::new(),
        });
        self.slots.len() - 1
    }

    fn concatenate(&mut self, node: &Node) -> Result<(), PlanError> {
        let mut first = 0;
        let mut wanted = Vec::new();
        for &v in &node.inputs {
            wanted.push((v, first));
            first += self.channels(v);
        }
        let of = |v: ValueId| (self.graph.values[v].name.as_str(), self.needs[v].size);
        let one = of(node.inputs[0]);
        let size = one.1;
        if let Some(&v) = node.inputs.iter().find(|&&v| self.needs[v].size != size) {
            return Err(PlanError::joined(&node.name, one, of(v)));
        }
        let takes = |slot: usize| {
            let s = &self.slots[slot];
            (s.height, s.width) == size
                && wanted.iter().all(|&(v, first)| match self.at[v] {
                    Some(at) => at == (slot, first),
                    None => self.fits(v, slot, first),
                })
        };
        let slot = (0..self.slots.len()).find(|&s| takes(s));
        let slot = slot.unwrap_or_else(|| self.new_slot(node.inputs[0]));
        for (v, first) in wanted {
            if self.at[v].is_some_and(|at| at != (slot, first)) {
                return Err(PlanError::shared(self.graph, v, &node.name));
            }
            self.settle(v, slot, first);
        }
        Ok(())
    }

    fn single(&mut self, v: ValueId) {
        let same = |s: &Draft| {
            (s.height, s.width) == self.needs[v].size
                && s.channels == self.channels(v)
                && s.halo == self.halos[v]
        };
        let free = (0..self.slots.len()).find(|&s| same(&self.slots[s]) && self.fits(v, s, 0));
        let slot = free.unwrap_or_else(|| self.new_slot(v));
        self.settle(v, slot, 0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::network::Network;

    fn plan(name: &str) -> (Graph, Plan) {
        let graph = Network::shipped(name).unwrap().graph().clone();
        let plan = Plan::new(&graph, 320, 512, 1, |_| 0).unwrap();
        (graph, plan)
    }

    #[test]
    fn every_network_has_a_proved_plan() {
        for name in Network::names() {
            let (graph, plan) = plan(name);
            plan.prove(&graph).unwrap();
        }
    }

    #[test]
    fn the_proof_sees_overlaps_and_gaps() {
        let (graph, plan) = plan("selecsls");
        let value = |name: &str| graph.values.iter().position(|v| v.name == name).unwrap();
        let mut wrong = plan.clone();
        wrong.values[value("features.1.conv3")] = plan.values[value("features.1.conv1")];
        assert!(
            wrong
                .prove(&graph)
                .unwrap_err()
                .to_string()
                .contains("overwrite")
        );
        let mut wrong = plan.clone();
        wrong
            .values
            .swap(value("features.1.conv3"), value("features.1.conv5"));
        assert!(wrong.prove(&graph).is_err());
    }

    #[test]
    fn values_of_unlike_sizes_are_not_joined() {
        let text = r#"
            name = "unlike"
            about = "a layer of half the size beside its input"
            input = { channels = 3, multiple = 16 }
            output = { head2d = "out" }
            layers = [
              { kind = "conv", name = "a", out = 8, kernel = 3, stride = 2 },
              { kind = "conv", name = "b", out = 8, kernel = 3, stride = 2 },
              { kind = "conv", name = "c", from = ["a", "b"], out = 8, kernel = 1 },
              { kind = "conv", name = "out", out = 40, kernel = 1, norm = false, relu = false },
            ]
        "#;
        let graph = Network::parse(text).unwrap().graph().clone();
        let said = Plan::new(&graph, 64, 96, 1, |_| 0).unwrap_err().to_string();
        assert!(
            said.starts_with("layer `c` joins `a` of 48x32 and `b` of 24x16"),
            "{said}"
        );
    }

    /// A network of these layers and two heads that read `x`; what a plan of it says, if anything.
    fn said(layers: &str) -> Option<String> {
        let text = format!(
            r#"
            name = "joins"
            about = "layers that are joined more than once"
            input = {{ channels = 3, multiple = 16 }}
            output = {{ head2d = "head2d.out", head3d = "head3d.out" }}
            layers = [
              {layers}
              {{ kind = "conv", name = "head2d.out", from = ["x"], out = 40, kernel = 1, norm = false, relu = false }},
              {{ kind = "conv", name = "head3d.out", from = ["x"], out = 63, kernel = 1, norm = false, relu = false }},
            ]
            "#
        );
        let graph = Network::parse(&text).unwrap().graph().clone();
        let plan = Plan::new(&graph, 64, 96, 1, |_| 0);
        plan.err().map(|e| e.to_string())
    }

    fn conv(name: &str, from: &[&str]) -> String {
        format!(r#"{{ kind = "conv", name = "{name}", from = {from:?}, out = 8, kernel = 1 }},"#)
    }

    #[test]
    fn who_does_what_a_refused_join_asks_for_has_a_plan() {
        let block = r#"
            { kind = "bottlenecks", name = "res", from = ["a"], width = 4, out = 8, blocks = 1, stride = 1 },
        "#;
        let inputs = ["a", "b", "c", "d"].map(|name| conv(name, &["input"]));
        let inputs = inputs.concat() + block;
        let others = ["b", "c", "d"];
        for joined in ["a", "res"] {
            // Later joins take the copies that were asked for; all three are needed to the end.
            let mut from = [joined.to_owned(), joined.to_owned(), joined.to_owned()];
            let mut copies = String::new();
            for join in [1, 2] {
                let joins = |from: &[String; 3]| {
                    let of = |i: usize| conv(&format!("j{i}"), &[from[i].as_str(), others[i]]);
                    (0..=join).map(of).collect::<String>()
                };
                let last: Vec<String> = (0..=join).map(|i| format!("j{i}")).collect();
                let last: Vec<&str> = last.iter().map(String::as_str).collect();
                let x = conv("x", &last);
                let asked = said(&format!("{inputs}{copies}{}{x}", joins(&from))).unwrap();
                let wanted = format!("layer `j{join}` joins `{joined}`, which");
                assert!(asked.starts_with(&wanted), "{asked}");
                let (_, copy) = asked.split_once("join a copy: ").unwrap();
                copies += &format!("{copy},");
                let (_, name) = copy.split_once(r#"name = ""#).unwrap();
                name.split('"').next().unwrap().clone_into(&mut from[join]);
                let now = said(&format!("{inputs}{copies}{}{x}", joins(&from)));
                assert_eq!(now, None, "{copies}");
            }
        }
    }

    #[test]
    fn the_picture_is_joined_beside_another_by_way_of_a_convolution() {
        let small = |joined: &str| {
            let layers = [
                conv("a", &["input"]),
                conv("b", &["input"]),
                conv("picture", &["input"]),
                conv("one", &["input", "a"]),
                conv("other", &["b", joined]),
                conv("x", &["one", "other"]),
            ];
            said(&layers.concat())
        };
        let asked = small("input").unwrap();
        assert!(
            asked.contains("`other` joins `input`, which") && asked.contains("a convolution of it"),
            "{asked}"
        );
        assert!(!asked.contains("maxpool"), "{asked}");
        assert_eq!(small("picture"), None);
    }

    #[test]
    fn buffers_are_limited_by_their_bytes() {
        let graph = Network::shipped("selecsls").unwrap().graph().clone();
        let plan = |element| Plan::new(&graph, 4096, 4096, element, |_| 0);
        assert!(plan(1).is_ok());
        let said = plan(4).unwrap_err().to_string();
        assert!(said.contains("more than 1073 MB"), "{said}");
    }

    #[test]
    fn one_concat_buffer_per_level() {
        let (graph, plan) = plan("selecsls");
        let slot = |name: &str| {
            let v = graph.values.iter().position(|v| v.name == name).unwrap();
            plan.occupied(v).unwrap().0
        };
        for (module, level) in [(0, 0), (1, 0), (2, 2), (3, 2), (4, 2), (5, 5), (8, 5)] {
            for conv in ["conv1", "conv3", "conv5"] {
                let a = slot(&format!("features.{module}.{conv}"));
                assert_eq!(
                    a,
                    slot(&format!("features.{level}.conv6")),
                    "{module} {conv}"
                );
            }
        }
        // About half of what one buffer per value would take without halos.
        let each = graph.values.iter().zip(&plan.sizes);
        let all: usize = each.map(|(v, (h, w))| v.channels * h * w).sum();
        assert!(10 * plan.len < 6 * all, "{} of {all} elements", plan.len);
    }
}
