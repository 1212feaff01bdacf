//! Levenberg–Marquardt with multiplicative damping.

use super::NormalEquations;

/// What is to be minimised.
pub trait LeastSquares {
    /// A point of the search with everything that cost and derivatives are computed from, such as a pose and its
    /// kinematics.
    type State;

    /// First column of every row of the normal matrix that may differ from zero.
    fn envelope(&self) -> &[usize];
    /// The cost of a state.
    fn cost(&self, at: &Self::State) -> f64;
    /// Adds gradient and Gauss–Newton matrix at a state to `out`, which is zero within [`envelope`](Self::envelope).
    fn linearise(&self, at: &Self::State, out: &mut NormalEquations);
    /// The state that lies `-descent` from `from`, in the order of rows, brought back within what is allowed.
    fn step(&self, from: &Self::State, descent: &[f64], to: &mut Self::State);
}

/// When to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Effort {
    /// Most linearisations.
    pub iterations: u32,
    /// Stop when a step lowers the cost by less than this fraction.
    pub tolerance: f64,
}

impl Effort {
    /// Of a pose that starts from a good guess, as the last frame's.
    pub const WARM: Self = Self {
        iterations: 4,
        tolerance: 0.01,
    };
    /// Of a pose that starts from nothing.
    pub const COLD: Self = Self {
        iterations: 25,
        tolerance: 1e-4,
    };
}

/// What a solve leaves behind.
#[derive(Debug, Clone, Copy)]
pub struct Outcome {
    /// Cost of the state found.
    pub cost: f64,
    /// Linearisations used.
    pub iterations: u32,
}

/// Reusable working memory.
#[derive(Debug, Clone, Default)]
pub struct Solver {
    linearised: NormalEquations,
    factor: NormalEquations,
}

impl Solver {
    /// Minimises from `state`, which is left where the cost is least; `spare` is working memory.
    pub fn solve<P: LeastSquares>(
        &mut self,
        problem: &P,
        effort: Effort,
        state: &mut P::State,
        spare: &mut P::State,
    ) -> Outcome {
        let mut cost = problem.cost(state);
        let mut damping = 1e-3;
        let mut iterations = 0;
        'outer: while iterations < effort.iterations {
            iterations += 1;
            self.linearised.reset(problem.envelope());
            problem.linearise(state, &mut self.linearised);
            loop {
                self.factor.copy_from(&self.linearised);
                self.factor.damp(damping);
                if self.factor.factorise() {
                    problem.step(state, self.factor.substitute(), spare);
                    let trial = problem.cost(spare);
                    // False for NaN as well: a bad step is never taken.
                    if trial < cost {
                        let gain = (cost - trial) / cost;
                        std::mem::swap(state, spare);
                        cost = trial;
                        damping = (damping * 0.1).max(1e-7);
                        if gain < effort.tolerance {
                            break 'outer;
                        }
                        break;
                    }
                }
                damping *= 10.0;
                if damping.is_nan() || damping >= 1e5 {
                    break 'outer;
                }
            }
        }
        Outcome { cost, iterations }
    }

    /// Gauss–Newton matrix and gradient of the last linearisation.
    pub fn last(&self) -> &NormalEquations {
        &self.linearised
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rosenbrock's valley as residuals 10 (y − x²) and 1 − x.
    struct Valley;

    impl LeastSquares for Valley {
        type State = [f64; 2];

        fn envelope(&self) -> &[usize] {
            &[0, 0]
        }

        fn cost(&self, &[x, y]: &[f64; 2]) -> f64 {
            (10.0 * (y - x * x)).powi(2) + (1.0 - x).powi(2)
        }

        fn linearise(&self, &[x, y]: &[f64; 2], out: &mut NormalEquations) {
            let rows = [
                ([-20.0 * x, 10.0], 10.0 * (y - x * x)),
                ([-1.0, 0.0], 1.0 - x),
            ];
            for (j, r) in rows {
                out.add(0, 0, j[0] * j[0]);
                out.add(1, 0, j[1] * j[0]);
                out.add(1, 1, j[1] * j[1]);
                out.pull(0, j[0] * r);
                out.pull(1, j[1] * r);
            }
        }

        fn step(&self, from: &[f64; 2], descent: &[f64], to: &mut [f64; 2]) {
            *to = [from[0] - descent[0], from[1] - descent[1]];
        }
    }

    #[test]
    fn the_bottom_of_the_valley_is_found() {
        let effort = Effort {
            iterations: 100,
            tolerance: 1e-14,
        };
        let mut state = [-1.2, 1.0];
        let found = Solver::default().solve(&Valley, effort, &mut state, &mut [0.0; 2]);
        assert!(found.cost < 1e-12 && found.iterations < 60, "{found:?}");
        assert!((state[0] - 1.0).abs() < 1e-6 && (state[1] - 1.0).abs() < 1e-6);
    }
}
