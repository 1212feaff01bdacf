//! What the reader in Rust prints: every field of every message.

use std::fmt::Write as _;

use edgecap_client::joints::{
    ANGLE_NAMES, COCO_JOINTS, COCO_KEYPOINTS, HUMANOID_BONES, HUMANOID_PARENTS, JOINT_NAMES,
    KINECT_JOINTS, KINECT_NAMES, PARENTS,
};
use edgecap_client::message::{
    Body, BodyFrame, Event, EventFrame, EventKind, HealthFrame, Intrinsics, Observation,
    ObservationFrame, StageTimes, World,
};

/// What every reader prints.
#[derive(Default)]
pub struct Print(pub String);

impl Print {
    fn line<T: std::fmt::Display>(&mut self, label: &str, values: impl IntoIterator<Item = T>) {
        self.0 += label;
        for v in values {
            write!(self.0, " {v}").unwrap();
        }
        self.0.push('\n');
    }

    fn bits<'a>(&mut self, label: &str, values: impl IntoIterator<Item = &'a f32>) {
        let bits = values.into_iter().map(|v| format!("{:08x}", v.to_bits()));
        self.line(label, bits);
    }

    pub fn names(&mut self) {
        self.line("joints", JOINT_NAMES);
        self.line("parents", PARENTS);
        self.line("angles", ANGLE_NAMES);
        self.line("bones", HUMANOID_BONES);
        self.line("carriers", HUMANOID_PARENTS);
        let each = |(name, joint): (&str, Option<usize>)| {
            format!("{name}={}", joint.map_or(-1, |j| j as i32))
        };
        self.line(
            "coco",
            COCO_KEYPOINTS.into_iter().zip(COCO_JOINTS).map(each),
        );
        self.line(
            "kinect",
            KINECT_NAMES.into_iter().zip(KINECT_JOINTS).map(each),
        );
        self.line("events", (0..).map_while(|n| EventKind::from(n).name()));
    }

    pub fn bodies(&mut self, frame: &BodyFrame) {
        // Without `..`: a field that is new wants a line here and in the other readers.
        let BodyFrame {
            sequence,
            capture_ns,
            pose_ns,
            publish_ns,
            width,
            height,
            intrinsics,
            stage_times,
            fit_us,
            flags,
            count,
            frame_total,
            world,
            bodies: _,
        } = frame;
        self.line("sequence", [sequence]);
        self.line("times", [capture_ns, pose_ns, publish_ns]);
        self.line("size", [width, height]);
        let Intrinsics { fx, fy, cx, cy } = intrinsics;
        self.bits("intrinsics", [fx, fy, cx, cy]);
        self.stages(stage_times);
        self.line("fit", [fit_us]);
        self.line("flags", [flags]);
        self.line("count", [count, frame_total]);
        let World {
            rotation,
            translation,
            state,
        } = world;
        self.bits("world", rotation.iter().chain(translation));
        self.line("floor", state.name());
        for body in frame.bodies() {
            self.body(frame, body);
        }
    }

    fn body(&mut self, frame: &BodyFrame, body: &Body) {
        let Body {
            id,
            state,
            score,
            position,
            orientation,
            velocity,
            angles,
            joints3d,
            joints2d,
            confidence,
            height,
            bone_lengths,
            bone_rotations,
            joint_states,
            reserved: _,
        } = body;
        self.line("id", [id]);
        self.line("state", state.name());
        self.bits("score", [score]);
        self.bits("position", position);
        self.bits("orientation", orientation);
        self.bits("velocity", velocity);
        self.bits("angles", angles);
        self.bits("joints3d", joints3d.iter().flatten());
        self.bits("joints2d", joints2d.iter().flatten());
        self.bits("confidence", confidence);
        self.bits("height", [height]);
        self.bits("bone_lengths", bone_lengths);
        self.bits("bone_rotations", bone_rotations.iter().flatten());
        self.line("joint_states", joint_states.map(|s| s.name().unwrap()));
        if let Some(there) = frame.in_world(body) {
            let numbers = there.position.into_iter().chain(there.orientation);
            let numbers = numbers.chain(there.velocity);
            self.line(
                "~there",
                numbers.chain(there.joints3d.into_iter().flatten()),
            );
        }
    }

    fn stages(&mut self, t: &StageTimes) {
        let StageTimes {
            preprocess_us,
            stage1_us,
            association_us,
            stage2_us,
        } = t;
        self.line(
            "stages",
            [preprocess_us, stage1_us, association_us, stage2_us],
        );
    }

    pub fn observations(&mut self, frame: &ObservationFrame) {
        let ObservationFrame {
            sequence,
            capture_ns,
            publish_ns,
            width,
            height,
            intrinsics: Intrinsics { fx, fy, cx, cy },
            stage_times,
            flags,
            without_neck,
            count,
            frame_total,
            people: _,
        } = frame;
        self.line("seen", [sequence]);
        self.line("times", [capture_ns, publish_ns]);
        self.line("size", [width, height]);
        self.bits("intrinsics", [fx, fy, cx, cy]);
        self.stages(stage_times);
        self.line("flags", [flags]);
        self.line("count", [count, frame_total, without_neck]);
        for person in frame.people() {
            let Observation {
                score,
                joints2d,
                joints3d,
                hue,
                saturation,
            } = person;
            self.bits("score", [score]);
            self.bits("joints2d", joints2d.iter().flatten());
            self.bits("joints3d", joints3d.iter().flatten());
            self.bits("hue", hue);
            self.bits("saturation", saturation);
        }
    }

    pub fn events(&mut self, frame: &EventFrame) {
        let EventFrame {
            sequence,
            time_ns,
            publish_ns,
            first,
            flags,
            count,
            present,
            main_person,
            events: _,
        } = frame;
        self.line("happened", [sequence]);
        self.line("times", [time_ns, publish_ns]);
        self.line("first", [first]);
        self.line("flags", [flags]);
        self.line("count", [count, present, main_person]);
        for event in frame.events() {
            let Event {
                kind,
                person,
                seconds,
                hand,
                zone: _,
            } = event;
            self.line("event", kind.name());
            self.line("person", [person]);
            self.bits("seconds", [seconds]);
            self.line("hand", hand.name());
            self.line("zone", Some(event.zone()).filter(|z| !z.is_empty()));
        }
    }

    pub fn health(&mut self, frame: &HealthFrame) {
        let HealthFrame {
            publish_ns,
            started_ns,
            since_ns,
            sequence,
            capture_ns,
            observed,
            left_out,
            state,
            flags,
            source_hz,
            observed_hz,
            look_hz,
            latency_us,
            pace,
            people,
            input_width,
            input_height,
            reconnects,
            restarts,
            cameras,
            cameras_live,
        } = frame;
        self.line("health", state.name());
        self.line("pace", pace.name());
        self.line("times", [publish_ns, started_ns, since_ns, capture_ns]);
        self.line("counts", [sequence, observed, left_out]);
        self.line("flags", [flags]);
        self.bits("rates", [source_hz, observed_hz, look_hz]);
        self.line("latency", [latency_us]);
        self.line("people", [people]);
        self.line("input", [input_width, input_height]);
        self.line("again", [reconnects, restarts]);
        self.line("cameras", [cameras, cameras_live]);
    }
}
