//! OpenCV's `FileStorage` as YAML: names to numbers, matrices and lists. No other YAML: its first line is none.

use std::collections::BTreeMap;

/// Most numbers of a matrix.
const MOST: usize = 1 << 16;
/// What stands before a matrix, and, since OpenCV 5, before an array of one dimension.
const MATRICES: [&str; 2] = ["!!opencv-matrix", "!!opencv-nd-matrix"];

/// Whether a matrix of OpenCV's is in a text.
pub(super) fn holds_matrix(text: &str) -> bool {
    MATRICES.iter().any(|kind| text.contains(kind))
}

/// What stands under a name.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Node {
    /// A number, a matrix row by row, or a list of numbers.
    Numbers(Vec<f64>),
    /// A word, or a list of them.
    Words(Vec<String>),
}

/// The names of a file.
#[derive(Debug, Default)]
pub(super) struct Storage(BTreeMap<String, Node>);

impl Storage {
    /// Reads a file's text. What it does not know it leaves out.
    pub fn parse(text: &str) -> Self {
        let mut nodes = BTreeMap::new();
        let mut lines = text.lines().peekable();
        while let Some(line) = lines.next() {
            let Some((key, rest)) = top_level(line) else {
                continue;
            };
            // All deeper lines, lists at the margin and what goes on over a line's end belong to the name.
            let mut body = rest.to_owned();
            while let Some(next) =
                lines.next_if(|l| l.starts_with([' ', '\t', '-']) && !l.starts_with("---"))
            {
                body.push('\n');
                body.push_str(next);
            }
            if let Some(node) = node(&body) {
                nodes.insert(unquoted(key).to_owned(), node);
            }
        }
        Self(nodes)
    }

    /// The numbers under the first of these names that has any.
    pub fn numbers(&self, names: &[&str]) -> Option<&[f64]> {
        names.iter().find_map(|name| match self.0.get(*name) {
            Some(Node::Numbers(numbers)) => Some(&numbers[..]),
            _ => None,
        })
    }

    /// A single number.
    pub fn number(&self, names: &[&str]) -> Option<f64> {
        match self.numbers(names)? {
            [one] => Some(*one),
            _ => None,
        }
    }

    /// Words under a name; numbers as they would be names.
    pub fn words(&self, name: &str) -> Option<Vec<String>> {
        match self.0.get(name)? {
            Node::Words(words) => Some(words.clone()),
            Node::Numbers(numbers) => Some(numbers.iter().map(ToString::to_string).collect()),
        }
    }

    /// Whether there is anything but one 0 under a name.
    pub fn is_set(&self, name: &str) -> bool {
        self.0
            .get(name)
            .is_some_and(|node| !matches!(node, Node::Numbers(all) if all[..] == [0.0]))
    }

    /// All names.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.0.keys().map(String::as_str)
    }
}

fn top_level(line: &str) -> Option<(&str, &str)> {
    if line.starts_with([' ', '\t', '#', '%', '-']) {
        return None;
    }
    line.split_once(':')
}

fn node(body: &str) -> Option<Node> {
    let data = match holds_matrix(body) {
        true => body.split_once("data:")?.1,
        false => body,
    };
    let items: Vec<&str> = if let Some(list) = data.trim_start().strip_prefix('[') {
        list.split(']').next()?.split(',').collect()
    } else if data.trim_start().starts_with('-') && data.contains('\n') {
        data.lines()
            .filter_map(|l| l.trim().strip_prefix('-'))
            .collect()
    } else {
        vec![data]
    };
    let items: Vec<&str> = items
        .into_iter()
        .map(str::trim)
        .filter(|i| !i.is_empty())
        .collect();
    if items.is_empty() || items.len() > MOST {
        return None;
    }
    let numbers: Option<Vec<f64>> = items.iter().map(|i| number(i)).collect();
    Some(match numbers {
        Some(numbers) => Node::Numbers(numbers),
        None => Node::Words(items.iter().map(|i| unquoted(i).to_owned()).collect()),
    })
}

fn number(item: &str) -> Option<f64> {
    match item {
        ".Nan" | ".NaN" | ".nan" => Some(f64::NAN),
        ".Inf" | "-.Inf" => Some(f64::INFINITY),
        // Quoted digits are a name.
        _ => item.parse().ok(),
    }
}

fn unquoted(item: &str) -> &str {
    item.trim().trim_matches(['"', '\''])
}
