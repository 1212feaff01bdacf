//! A reader of BVH that shares nothing with the writer.

use glam::{DQuat, DVec3};

/// A BVH file, read by the format's description: matrices multiplied in the order of the channels.
pub struct Bvh {
    nodes: Vec<BvhNode>,
    pub step: f64,
    pub rows: Vec<Vec<f64>>,
}

struct BvhNode {
    name: String,
    parent: Option<usize>,
    offset: DVec3,
    channels: Vec<String>,
}

impl Bvh {
    pub fn read(text: &str) -> Self {
        let (hierarchy, motion) = text.split_once("MOTION").unwrap();
        let mut nodes: Vec<BvhNode> = Vec::new();
        let mut open: Vec<usize> = Vec::new();
        let mut words = hierarchy.split_whitespace();
        assert_eq!(words.next(), Some("HIERARCHY"));
        while let Some(word) = words.next() {
            match word {
                "ROOT" | "JOINT" | "End" => {
                    let mut name = words.next().unwrap().to_owned();
                    if word == "End" {
                        name = format!("{} end", nodes[*open.last().unwrap()].name);
                    }
                    nodes.push(BvhNode {
                        name,
                        parent: open.last().copied(),
                        offset: DVec3::ZERO,
                        channels: Vec::new(),
                    });
                }
                "{" => open.push(nodes.len() - 1),
                "}" => drop(open.pop().unwrap()),
                "OFFSET" => {
                    let node = nodes.last_mut().unwrap();
                    node.offset = DVec3::from_array([(); 3].map(|()| number(&mut words)));
                }
                "CHANNELS" => {
                    let n = words.next().unwrap().parse().unwrap();
                    let node = nodes.last_mut().unwrap();
                    node.channels = words.by_ref().take(n).map(ToOwned::to_owned).collect();
                }
                other => panic!("{other} in the hierarchy"),
            }
        }
        assert!(open.is_empty());
        let mut lines = motion.trim().lines();
        let value = |line: &str| line.rsplit(' ').next().unwrap().parse::<f64>().unwrap();
        let frames = value(lines.next().unwrap()) as usize;
        let step = value(lines.next().unwrap());
        let rows: Vec<Vec<f64>> = lines
            .map(|l| l.split(' ').map(|n| n.parse().unwrap()).collect())
            .collect();
        assert_eq!(rows.len(), frames);
        Self { nodes, step, rows }
    }

    /// Every node's place in a frame, metres.
    pub fn places(&self, frame: usize) -> Vec<(String, DVec3)> {
        let mut values = self.rows[frame].iter().copied();
        let mut found: Vec<(DQuat, DVec3)> = Vec::new();
        for node in &self.nodes {
            let (turn, at) = match node.parent {
                Some(p) => found[p],
                None => (DQuat::IDENTITY, DVec3::ZERO),
            };
            let (mut own, mut moved) = (DQuat::IDENTITY, node.offset);
            for channel in &node.channels {
                let value = values.next().unwrap();
                let angle = value.to_radians();
                match channel.as_str() {
                    "Xposition" => moved.x += value,
                    "Yposition" => moved.y += value,
                    "Zposition" => moved.z += value,
                    "Xrotation" => own *= DQuat::from_rotation_x(angle),
                    "Yrotation" => own *= DQuat::from_rotation_y(angle),
                    "Zrotation" => own *= DQuat::from_rotation_z(angle),
                    other => panic!("a channel {other}"),
                }
            }
            found.push((turn * own, at + turn * moved));
        }
        assert_eq!(values.next(), None);
        let names = self.nodes.iter().map(|n| n.name.clone());
        names.zip(found.iter().map(|(_, at)| *at / 100.0)).collect()
    }
}

fn number<'a>(words: &mut impl Iterator<Item = &'a str>) -> f64 {
    words.next().unwrap().parse().unwrap()
}
