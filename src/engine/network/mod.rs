//! Networks as data: a file of `models/` goes in, the [`Graph`] of its operations comes out.

mod expand;
mod graph;
mod spec;

pub use graph::{Graph, Node, Op, ParamNames, Value, ValueId};
pub use spec::InputSpec;

use spec::{LayerSpec, NetworkSpec};

/// What is wrong with a network file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NetworkError {
    /// Not one of the shipped networks.
    #[error(
        "no network named `{found}`: choose one of {known}; the path of a .toml file is for `--arch` of `edgecap model`"
    )]
    Unknown {
        /// What was asked for.
        found: String,
        /// What there is.
        known: String,
    },
    /// Not the format.
    #[error("the network file does not parse: {0}")]
    Syntax(#[from] toml::de::Error),
    /// Parses, but cannot be a network.
    #[error("network `{network}`: {found}; {remedy}")]
    Inconsistent {
        /// Its name.
        network: String,
        /// What was found.
        found: String,
        /// What to do.
        remedy: String,
    },
}

/// A network without its weights.
#[derive(Debug, Clone)]
pub struct Network {
    name: String,
    about: String,
    input: InputSpec,
    graph: Graph,
    modules: Vec<[usize; 5]>,
    source: String,
}

/// Every network that ships with the program: name, text.
const SHIPPED: [(&str, &str); 5] = [
    ("selecsls", include_str!("../../../models/selecsls.toml")),
    (
        "selecsls42",
        include_str!("../../../models/selecsls42.toml"),
    ),
    (
        "selecsls60",
        include_str!("../../../models/selecsls60.toml"),
    ),
    (
        "selecsls84",
        include_str!("../../../models/selecsls84.toml"),
    ),
    ("resnet50", include_str!("../../../models/resnet50.toml")),
];

impl Network {
    /// A network that ships with the program.
    ///
    /// # Errors
    /// [`NetworkError::Unknown`] where none has this name.
    pub fn shipped(name: &str) -> Result<Self, NetworkError> {
        match SHIPPED.iter().find(|(n, _)| *n == name) {
            Some((_, text)) => Self::parse(text),
            None => Err(NetworkError::Unknown {
                found: name.into(),
                known: Self::names().collect::<Vec<_>>().join(", "),
            }),
        }
    }

    /// Names of the networks that ship with the program.
    pub fn names() -> impl Iterator<Item = &'static str> {
        SHIPPED.iter().map(|(n, _)| *n)
    }

    /// Reads the text of a network file.
    ///
    /// # Errors
    /// [`NetworkError::Syntax`] where the text is no network file, [`NetworkError::Inconsistent`] where its layers
    /// cannot be a network.
    pub fn parse(text: &str) -> Result<Self, NetworkError> {
        let spec: NetworkSpec = toml::from_str(text)?;
        let graph = expand::expand(&spec)?;
        let modules = spec.layers.iter().filter_map(|l| match l {
            LayerSpec::Selecsls { modules, .. } => Some(modules.clone()),
            _ => None,
        });
        Ok(Self {
            modules: modules.flatten().collect(),
            name: spec.name,
            about: spec.about,
            input: spec.input,
            graph,
            source: text.into(),
        })
    }

    /// Short name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// One line for people.
    pub fn about(&self) -> &str {
        &self.about
    }

    /// What goes in.
    pub fn input(&self) -> InputSpec {
        self.input
    }

    /// Its operations.
    pub fn graph(&self) -> &Graph {
        &self.graph
    }

    /// The SelecSLS modules `[in, skip, k, out, stride]`; empty for other networks.
    pub fn modules(&self) -> &[[usize; 5]] {
        &self.modules
    }

    /// The text it was read from.
    pub fn source(&self) -> &str {
        &self.source
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counts(name: &str) -> (f64, f64) {
        let n = Network::shipped(name).unwrap();
        let g = n.graph();
        (g.macs(320, 512) as f64 / 1e9, g.parameters() as f64 / 1e6)
    }

    fn core_macs(name: &str) -> f64 {
        let n = Network::shipped(name).unwrap();
        let g = n.graph();
        let sizes = g.sizes(320, 512);
        let core = g.nodes.iter().filter(|n| !n.name.starts_with("head"));
        core.map(|n| {
            n.conv()
                .map_or(0, |s| s.macs(sizes[n.inputs[0]].0, sizes[n.inputs[0]].1))
        })
        .sum::<u64>() as f64
            / 1e9
    }

    #[test]
    fn stage_one_has_the_published_size() {
        let (gmac, mparam) = counts("selecsls");
        assert!((gmac - 8.85).abs() < 0.005, "{gmac} GMAC");
        assert!((mparam - 6.2).abs() < 0.05, "{mparam} M parameters");
        assert!((core_macs("selecsls") - 6.60).abs() < 0.005);
    }

    #[test]
    fn the_baseline_has_the_published_size() {
        let (gmac, _) = counts("resnet50");
        assert!((gmac - 17.3).abs() < 0.05, "{gmac} GMAC");
        assert!(
            (core_macs("resnet50") - 14.56).abs() < 0.005,
            "{}",
            core_macs("resnet50")
        );
    }

    #[test]
    fn every_shipped_network_gives_both_heads_at_an_eighth() {
        for name in Network::names() {
            let n = Network::shipped(name).unwrap();
            let sizes = n.graph().sizes(320, 512);
            for (output, channels) in [("head2d", 40), ("head3d", 63)] {
                let (_, v) = n.graph().outputs.iter().find(|(o, _)| o == output).unwrap();
                assert_eq!(n.graph().values[*v].channels, channels, "{name} {output}");
                assert_eq!(sizes[*v], (40, 64), "{name} {output}");
            }
        }
    }

    fn with_layers(layers: &str) -> Result<Network, NetworkError> {
        Network::parse(&format!(
            r#"
            name = "small"
            about = "what a test wants"
            input = {{ channels = 3, multiple = 16 }}
            output = {{ out = "last" }}
            layers = [{layers}
              {{ kind = "conv", name = "last", out = 4, kernel = 1 }},
            ]
            "#
        ))
    }

    #[test]
    fn what_can_be_negative_is_not_pooled() {
        let pooled = |before: &str| {
            let pool = r#"{ kind = "maxpool", name = "pool", kernel = 3, stride = 2 },"#;
            with_layers(&format!("{before} {pool}"))
        };
        let conv = |relu: bool| {
            format!(r#"{{ kind = "conv", name = "a", out = 4, kernel = 3, relu = {relu} }},"#)
        };
        let first = r#"{ kind = "maxpool", name = "first", kernel = 3, stride = 2 },"#;
        assert!(pooled(&conv(true)).is_ok());
        assert!(pooled(&format!("{} {first}", conv(true))).is_ok());
        for (before, pool, input) in [
            (String::new(), "pool", "input"),
            (conv(false), "pool", "a"),
            (format!("{} {first}", conv(false)), "first", "a"),
        ] {
            let said = pooled(&before).unwrap_err().to_string();
            let wanted = format!("pooling `{pool}` reads `{input}`, which can be negative");
            assert!(said.contains(&wanted), "{said}");
        }
        // A copy is no window, and as negative as what it copies.
        let copy = r#"{ kind = "maxpool", name = "copy", kernel = 1, stride = 1 },"#;
        let linear = format!("{} {copy}", conv(false));
        assert!(with_layers(&linear).is_ok());
        let said = pooled(&linear).unwrap_err().to_string();
        assert!(said.contains("`pool` reads `copy`, which can be"), "{said}");
        let said = with_layers(copy).unwrap_err().to_string();
        assert!(said.contains("`copy` copies `input`"), "{said}");
    }

    /// Whoever walks the chain at each of its pools, and looks for each writer among all layers, takes minutes.
    #[test]
    fn a_long_chain_of_pools_is_read_at_once() {
        let pool =
            |i: u32| format!(r#"{{ kind = "maxpool", name = "{i}", kernel = 3, stride = 1 }},"#);
        let mut layers = vec![r#"{ kind = "conv", name = "a", out = 4, kernel = 1 },"#.to_owned()];
        layers.extend((0..9_000).map(pool));
        let network = with_layers(&layers.concat()).unwrap();
        assert_eq!(network.graph().nodes.len(), 9_002);
    }

    /// 2⁵² weights a layer, of which 4096 are more than can be counted.
    #[test]
    fn weights_beyond_counting_are_as_many_as_can_be_counted() {
        let layer = |i: u32| {
            format!(
                r#"{{ kind = "conv", name = "{i}", out = 1048576, kernel = 64, stride = 64 }},"#
            )
        };
        let layers: String = (0..4_200).map(layer).collect();
        let network = with_layers(&layers).unwrap();
        assert_eq!(network.graph().parameters(), usize::MAX);
    }

    #[test]
    fn an_output_that_a_layer_reads_is_refused() {
        let text = Network::shipped("selecsls").unwrap().source().to_string();
        let read = text.replace(r#"head2d = "head2d.out""#, r#"head2d = "head2d.conv1""#);
        assert_ne!(read, text);
        let said = Network::parse(&read).unwrap_err().to_string();
        let wanted = "output `head2d.conv1` is also read by `head2d.conv2`";
        assert!(said.contains(wanted), "{said}");
    }

    #[test]
    fn layers_are_known_by_the_names_that_a_file_gives_them() {
        let network = Network::shipped("resnet50").unwrap();
        let graph = network.graph();
        assert_eq!(graph.layers["input"], Graph::INPUT);
        let block = graph.layers["layer1"];
        assert_eq!(graph.values[block].name, "layer1.2.conv3");
        assert!(!graph.layers.contains_key("layer1.2.conv3"));
    }

    #[test]
    fn parts_of_blocks_share_no_name_with_layers() {
        let res = r#"{ kind = "bottlenecks", name = "res", width = 4, out = 8, blocks = 1, stride = 1 },"#;
        let other =
            |name: &str| format!(r#"{{ kind = "conv", name = "{name}", out = 8, kernel = 1 }},"#);
        assert!(with_layers(&format!("{} {res}", other("res.conv1"))).is_ok());
        for layers in [
            format!("{} {res}", other("res.0.conv1")),
            format!("{res} {}", other("res.0.conv1")),
            format!("{res} {}", other("res.0.downsample")),
        ] {
            let said = with_layers(&layers).unwrap_err().to_string();
            assert!(said.contains("two layers are named `res.0."), "{said}");
        }
    }

    #[test]
    fn layers_that_say_what_they_do_not_do_are_refused() {
        for (layer, wanted) in [
            (
                r#"{ kind = "bottlenecks", name = "res", width = 4, out = 8, blocks = 0, stride = 1 },"#,
                "layer `res` has no blocks",
            ),
            (
                r#"{ kind = "selecsls", name = "core", modules = [] },"#,
                "layer `core` has no modules",
            ),
            (
                r#"{ kind = "conv", name = "a", out = 8, kernel = 1, norm = false, norm_name = "bn" },"#,
                "layer `a` has `norm_name` beside `norm = false`",
            ),
        ] {
            let said = with_layers(layer).unwrap_err().to_string();
            assert!(said.contains(wanted), "{said}");
        }
    }

    #[test]
    fn a_network_that_reads_no_rgb_is_refused() {
        let text = Network::shipped("selecsls").unwrap().source().to_string();
        for channels in [0, 1, 4] {
            let other = text.replace("channels = 3", &format!("channels = {channels}"));
            assert_ne!(other, text);
            let said = Network::parse(&other).unwrap_err().to_string();
            assert!(
                said.contains(&format!("an input of {channels} channels"))
                    && said.contains("give 3"),
                "{said}"
            );
        }
    }

    #[test]
    fn bottlenecks_that_read_two_layers_add_both() {
        let graph = |from: &str| {
            let network = with_layers(&format!(
                r#"
                {{ kind = "conv", name = "a", out = 8, kernel = 3 }},
                {{ kind = "conv", name = "b", out = 8, kernel = 3 }},
                {{ kind = "bottlenecks", name = "res", from = [{from}], width = 4, out = 8, blocks = 2, stride = 1 }},
                "#
            ));
            network.unwrap().graph().clone()
        };
        let shortcut = |graph: &Graph, block: &str| {
            let last = graph.nodes.iter().find(|n| n.name == block).unwrap();
            graph.values[last.residual.unwrap()].name.clone()
        };
        let both = graph(r#""a", "b""#);
        assert_eq!(shortcut(&both, "res.0.conv3"), "res.0.downsample");
        assert_eq!(shortcut(&both, "res.1.conv3"), "res.0.conv3");
        assert_eq!(shortcut(&graph(r#""a""#), "res.0.conv3"), "a");
    }

    #[test]
    fn wrong_tables_say_where() {
        let text = Network::shipped("selecsls").unwrap().source().to_string();
        let wrong = text.replace("[128, 0, 128, 128, 2]", "[120, 0, 128, 128, 2]");
        let e = Network::parse(&wrong).unwrap_err().to_string();
        assert!(e.contains("features.2") && e.contains("120"), "{e}");
        let unknown = text.replace("groups = 4 }", "dilation = 4 }");
        assert!(
            Network::parse(&unknown)
                .unwrap_err()
                .to_string()
                .contains("dilation")
        );
        assert!(
            Network::shipped("vgg")
                .unwrap_err()
                .to_string()
                .contains("resnet50")
        );
    }
}
