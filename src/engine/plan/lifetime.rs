//! When every value is alive, in steps of the run.

use crate::engine::network::{Graph, ValueId};

/// First and last step that touches a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Lifetime {
    pub first: usize,
    pub last: usize,
}

impl Lifetime {
    pub fn overlaps(self, other: Self) -> bool {
        self.first <= other.last && other.first <= self.last
    }
}

/// Lifetimes of all values: written at the step of their node, read until their last consumer; the input from before
/// the first step, outputs to the end.
pub(super) fn of(graph: &Graph) -> Vec<Lifetime> {
    let mut lives = vec![Lifetime { first: 0, last: 0 }; graph.values.len()];
    for (step, node) in graph.nodes.iter().enumerate() {
        lives[node.output] = Lifetime {
            first: step,
            last: step,
        };
        for v in readers(node) {
            lives[v].last = step;
        }
    }
    for (_, v) in &graph.outputs {
        lives[*v].last = graph.nodes.len();
    }
    lives
}

fn readers(node: &crate::engine::network::Node) -> impl Iterator<Item = ValueId> + '_ {
    node.inputs.iter().chain(&node.residual).copied()
}
