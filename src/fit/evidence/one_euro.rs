//! In: noisy points with true timestamps. Out: the same points, smoothed the more the slower they move. Casiez et al.
//! 2012.

use crate::fit::config::OneEuroConfig;

/// 1€ filter of a point with `N` coordinates; one speed for all of them, so that it does not depend on the axes.
#[derive(Debug, Clone, Copy)]
pub struct OneEuro<const N: usize> {
    state: Option<State<N>>,
}

#[derive(Debug, Clone, Copy)]
struct State<const N: usize> {
    value: [f64; N],
    rate: [f64; N],
    age: f64,
}

impl<const N: usize> Default for OneEuro<N> {
    fn default() -> Self {
        Self { state: None }
    }
}

impl<const N: usize> OneEuro<N> {
    /// Forgets everything.
    pub fn reset(&mut self) {
        self.state = None;
    }

    /// Time passes without an observation.
    pub fn skip(&mut self, dt: f64) {
        if let Some(state) = &mut self.state {
            state.age += dt;
        }
    }

    /// Takes the next point, `dt` seconds after the last call of this or [`skip`](Self::skip), and returns the smoothed
    /// one. `scale` turns the point's unit into metres.
    pub fn update(
        &mut self,
        point: [f64; N],
        dt: f64,
        scale: f64,
        config: &OneEuroConfig,
    ) -> [f64; N] {
        let Some(state) = &mut self.state else {
            self.state = Some(State {
                value: point,
                rate: [0.0; N],
                age: 0.0,
            });
            return point;
        };
        let dt = (dt + state.age).max(1e-4);
        let a = smoothing(config.derivative_cutoff, dt);
        let mut speed = 0.0;
        for i in 0..N {
            let rate = (point[i] - state.value[i]) / dt;
            state.rate[i] += a * (rate - state.rate[i]);
            speed += state.rate[i] * state.rate[i];
        }
        let cutoff = config.min_cutoff + config.beta * speed.sqrt() * scale;
        let a = if config.enabled {
            smoothing(cutoff, dt)
        } else {
            1.0
        };
        for i in 0..N {
            state.value[i] += a * (point[i] - state.value[i]);
        }
        state.age = 0.0;
        state.value
    }
}

/// Share of the new value in a first-order low pass.
fn smoothing(cutoff: f64, dt: f64) -> f64 {
    let r = std::f64::consts::TAU * cutoff * dt;
    r / (r + 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONFIG: OneEuroConfig = OneEuroConfig {
        enabled: true,
        min_cutoff: 1.0,
        beta: 0.5,
        derivative_cutoff: 1.0,
    };

    /// The authors' reference, one coordinate, fixed rate.
    fn reference(xs: &[f64], dt: f64) -> Vec<f64> {
        let alpha = |fc: f64| 1.0 / (1.0 + (1.0 / (std::f64::consts::TAU * fc)) / dt);
        let (mut x, mut dx) = (xs[0], 0.0);
        let mut out = vec![x];
        for &v in &xs[1..] {
            let rate = (v - x) / dt;
            dx = alpha(1.0) * rate + (1.0 - alpha(1.0)) * dx;
            let a = alpha(1.0 + 0.5 * f64::abs(dx));
            x = a * v + (1.0 - a) * x;
            out.push(x);
        }
        out
    }

    #[test]
    fn follows_the_reference() {
        let xs: Vec<f64> = (0..100)
            .map(|i| (i as f64 * 0.2).sin() + 0.1 * ((i * 37 % 11) as f64))
            .collect();
        let mut filter = OneEuro::<1>::default();
        for (x, expected) in xs.iter().zip(reference(&xs, 0.033)) {
            let got = filter.update([*x], 0.033, 1.0, &CONFIG);
            assert!((got[0] - expected).abs() < 1e-12);
        }
    }

    #[test]
    fn a_dropped_frame_counts_its_time() {
        let mut steady = OneEuro::<2>::default();
        let mut gappy = OneEuro::<2>::default();
        for f in [&mut steady, &mut gappy] {
            f.update([0.0, 0.0], 0.033, 1.0, &CONFIG);
        }
        gappy.skip(0.033);
        let a = steady.update([1.0, 1.0], 0.066, 1.0, &CONFIG);
        let b = gappy.update([1.0, 1.0], 0.033, 1.0, &CONFIG);
        assert_eq!(a, b);
    }

    #[test]
    fn rest_is_smoothed_and_speed_is_followed() {
        let mut filter = OneEuro::<1>::default();
        let noise = |i: usize| if i.is_multiple_of(2) { 0.05 } else { -0.05 };
        let rest: Vec<f64> = (0..60)
            .map(|i| filter.update([noise(i)], 0.033, 1.0, &CONFIG)[0])
            .collect();
        assert!(rest[30..].iter().all(|v| v.abs() < 0.02));
        let fast = OneEuroConfig {
            beta: 50.0,
            ..CONFIG
        };
        let mut filter = OneEuro::<1>::default();
        let mut lag = 0.0;
        for i in 0..30 {
            let x = i as f64 * 0.1;
            lag = x - filter.update([x], 0.033, 1.0, &fast)[0];
        }
        assert!(lag < 0.1, "less than one frame behind: {lag}");
    }
}
