//! Messages with numbers in every field.

use edgecap_client::message::{
    Body, BodyFrame, Event, EventFrame, HealthFrame, Intrinsics, Observation, ObservationFrame,
    StageTimes, World,
};

/// Numbers without a pattern, the same every time.
pub struct Numbers(pub u64);

impl Numbers {
    fn next(&mut self) -> u32 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 32) as u32
    }

    fn long(&mut self) -> u64 {
        (u64::from(self.next()) << 32) | u64::from(self.next())
    }

    fn float(&mut self) -> f32 {
        self.next() as f32 / 2f32.powi(29) - 4.0
    }

    fn floats<const N: usize>(&mut self) -> [f32; N] {
        std::array::from_fn(|_| self.float())
    }

    fn table<const N: usize, const M: usize>(&mut self) -> [[f32; N]; M] {
        std::array::from_fn(|_| self.floats())
    }
}

fn some_body(n: &mut Numbers) -> Body {
    Body {
        id: n.next(),
        state: (n.next() % 3).into(),
        score: n.float(),
        position: n.floats(),
        orientation: n.floats(),
        velocity: n.floats(),
        angles: n.floats(),
        joints3d: n.table(),
        joints2d: n.table(),
        confidence: n.floats(),
        height: n.float(),
        bone_lengths: n.floats(),
        bone_rotations: n.table(),
        joint_states: std::array::from_fn(|_| ((n.next() % 3) as u8).into()),
        reserved: [0; 3],
    }
}

pub fn some_bodies(n: &mut Numbers, count: usize, flags: u32) -> BodyFrame {
    let (intrinsics, stage_times) = some_camera(n);
    BodyFrame {
        sequence: n.long(),
        capture_ns: n.long(),
        pose_ns: n.long(),
        publish_ns: n.long(),
        width: n.next(),
        height: n.next(),
        intrinsics,
        stage_times,
        fit_us: n.next(),
        flags,
        count: count as u32,
        frame_total: n.next(),
        world: World {
            rotation: n.floats(),
            translation: n.floats(),
            state: (count as u32 % 3).into(),
        },
        // Those beyond the count must not be read.
        bodies: std::array::from_fn(|_| some_body(n)),
    }
}

fn some_camera(n: &mut Numbers) -> (Intrinsics, StageTimes) {
    let intrinsics = Intrinsics {
        fx: n.float(),
        fy: n.float(),
        cx: n.float(),
        cy: n.float(),
    };
    let stage_times = StageTimes {
        preprocess_us: n.next(),
        stage1_us: n.next(),
        association_us: n.next(),
        stage2_us: n.next(),
    };
    (intrinsics, stage_times)
}

pub fn some_observations(n: &mut Numbers, count: usize, flags: u32) -> ObservationFrame {
    let (intrinsics, stage_times) = some_camera(n);
    ObservationFrame {
        sequence: n.long(),
        capture_ns: n.long(),
        publish_ns: n.long(),
        width: n.next(),
        height: n.next(),
        intrinsics,
        stage_times,
        flags,
        without_neck: n.next(),
        count: count as u32,
        frame_total: n.next(),
        people: std::array::from_fn(|_| Observation {
            score: n.float(),
            joints2d: n.table(),
            joints3d: n.table(),
            hue: n.floats(),
            saturation: n.floats(),
        }),
    }
}

pub fn some_events(n: &mut Numbers, count: usize, flags: u32) -> EventFrame {
    EventFrame {
        sequence: n.long(),
        time_ns: n.long(),
        publish_ns: n.long(),
        first: n.long(),
        flags,
        count: count as u32,
        present: n.next(),
        main_person: n.next(),
        events: std::array::from_fn(|i| {
            let mut event = Event {
                kind: (n.next() % 10).into(),
                person: n.next(),
                seconds: n.float(),
                hand: (n.next() % 3).into(),
                ..Event::default()
            };
            event.set_zone(["", "door", "Tür", &"x".repeat(80)][i % 4]);
            event
        }),
    }
}

pub fn some_health(n: &mut Numbers, state: usize, flags: u32) -> HealthFrame {
    HealthFrame {
        publish_ns: n.long(),
        started_ns: n.long(),
        since_ns: n.long(),
        sequence: n.long(),
        capture_ns: n.long(),
        observed: n.long(),
        left_out: n.long(),
        state: (state as u32).into(),
        flags,
        source_hz: n.float(),
        observed_hz: n.float(),
        look_hz: n.float(),
        latency_us: n.next(),
        pace: (n.next() % 3).into(),
        people: n.next(),
        input_width: n.next(),
        input_height: n.next(),
        reconnects: n.next(),
        restarts: n.next(),
        cameras: n.next(),
        cameras_live: n.next(),
    }
}
