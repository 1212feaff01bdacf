//! SMPL-format archives: bytes go in, a checked [`MeshBody`] comes out.

use std::io::{Read, Seek};

use super::skin::Weights;
use super::{CORRECTIVES, JOINTS, MeshBody, MeshError, PARENTS, REPORTED, Reported};
use crate::body::model::Elimination;
use crate::joints::HEAD_TOP;
use crate::npz::{Archive, Numbers};

/// More vertices than any body model has: what a damaged header may ask for ends here.
const MOST_VERTICES: usize = 200_000;
const MOST_COMPONENTS: usize = 300;
/// How far a row of weights may be from summing to one before it is taken for something else.
const SUM_TOLERANCE: f64 = 0.02;
/// Metres: a body's vertices lie within this of its origin.
const REACH: f64 = 10.0;

/// Rows of a regressor: vertex and weight.
type Rows = Vec<Vec<(usize, f64)>>;

impl MeshBody {
    /// Reads a body model: `v_template`, `f`, `shapedirs`, `J_regressor` (dense, or `J_regressor_data`, `_indices` and
    /// `_indptr` of one compressed by rows or by columns), `weights`, `kintree_table`; `posedirs` may be absent or
    /// empty. An array may have its unit beside it (`X_unit`).
    ///
    /// # Errors
    /// When the archive is damaged, an array is missing, or shapes, numbers, axes or the tree are not those of SMPL's
    /// format.
    pub fn read<R: Read + Seek>(mut reader: R) -> Result<Self, MeshError> {
        if is_pickle(&mut reader) {
            return Err(MeshError::Pickle);
        }
        let mut file = File(Archive::new(reader)?);
        file.tree()?;
        let template = file.need("v_template")?;
        let count = match template.shape[..] {
            [n, 3] if (4..=MOST_VERTICES).contains(&n) => n,
            _ => {
                return Err(MeshError::unfit(
                    "v_template",
                    format!("4 to {MOST_VERTICES} vertices of 3 coordinates"),
                    shape(&template),
                ));
            }
        };
        if let Some(far) = template.data.iter().find(|x| x.abs() > REACH) {
            let expected = format!("metres, none beyond {REACH}");
            return Err(MeshError::unfit("v_template", expected, far.to_string()));
        }
        let components = file.need("shapedirs")?;
        let width = match components.shape[..] {
            [n, 3, k] if n == count && (1..=MOST_COMPONENTS).contains(&k) => k,
            _ => {
                let expected = format!("{count}x3x1 to {count}x3x{MOST_COMPONENTS} numbers");
                return Err(MeshError::unfit("shapedirs", expected, shape(&components)));
            }
        };
        let correctives = file.correctives(count)?;
        let faces = file.faces(count)?;
        let weights = file.weights(count)?;
        let regressor = file.regressor(count)?;
        let reported = file.reported(count)?;

        let components = columns(&components, width);
        let template = vertices(&template);
        let at_rest = |rows: &Rows, of: &[[f32; 3]]| -> Vec<[f64; 3]> {
            let point = |row: &Vec<(usize, f64)>| {
                row.iter().fold([0.0; 3], |sum, &(v, w)| {
                    std::array::from_fn(|k| sum[k] + w * f64::from(of[v][k]))
                })
            };
            rows.iter().map(point).collect()
        };
        let joints = fixed(&at_rest(&regressor, &template));
        upright(&joints)?;
        let joint_components: Vec<_> = components
            .iter()
            .map(|c| fixed(&at_rest(&regressor, c)))
            .collect();
        let rows = reported.unwrap_or_else(|| untold(&regressor, &template, &weights));
        let reported = Reported {
            carrier: super::kinematics::CARRIERS,
            rest: fixed(&at_rest(&rows, &template)),
            components: components
                .iter()
                .map(|c| fixed(&at_rest(&rows, c)))
                .collect(),
        };
        let chains: Vec<Vec<usize>> = (0..JOINTS).map(super::kinematics::moved_by).collect();
        let elimination =
            Elimination::from_the_last(super::FREEDOM, chains.iter().map(Vec::as_slice));
        Ok(Self {
            template,
            components,
            correctives,
            faces,
            weights,
            joints,
            joint_components,
            reported,
            elimination,
        })
    }
}

struct File<R>(Archive<R>);

impl<R: Read + Seek> File<R> {
    fn find(&mut self, name: &str) -> Result<Option<Numbers>, MeshError> {
        let Some(mut array) = self.0.numbers(name)? else {
            return Ok(None);
        };
        if let Some(unit) = self.0.numbers(&format!("{name}_unit"))? {
            let [unit] = unit.data[..] else {
                return Err(MeshError::unfit(
                    &format!("{name}_unit"),
                    "one number",
                    shape(&unit),
                ));
            };
            array.data.iter_mut().for_each(|x| *x *= unit);
        }
        if let Some(bad) = array.data.iter().find(|x| !x.is_finite()) {
            return Err(MeshError::unfit(name, "finite numbers", bad.to_string()));
        }
        Ok(Some(array))
    }

    fn need(&mut self, name: &str) -> Result<Numbers, MeshError> {
        self.find(name)?
            .ok_or_else(|| MeshError::Missing { name: name.into() })
    }

    fn tree(&mut self) -> Result<(), MeshError> {
        let table = self.need("kintree_table")?;
        let expected = "SMPL's tree of 24 joints";
        if table.shape[..] != [2, JOINTS] {
            return Err(MeshError::unfit("kintree_table", expected, shape(&table)));
        }
        let (parents, joints) = table.data.split_at(JOINTS);
        for (joint, (&found, &id)) in parents.iter().zip(joints).enumerate() {
            let parent = PARENTS[joint];
            let found = if id != joint as f64 {
                format!("joint {id} in place of {joint}")
            } else if joint > 0 && found != parent as f64 {
                format!("joint {joint} on {found} instead of {parent}")
            } else {
                continue;
            };
            return Err(MeshError::unfit("kintree_table", expected, found));
        }
        Ok(())
    }

    fn correctives(&mut self, count: usize) -> Result<Vec<Vec<[f32; 3]>>, MeshError> {
        let Some(array) = self.find("posedirs")? else {
            return Ok(Vec::new());
        };
        match array.shape[..] {
            _ if array.data.is_empty() => Ok(Vec::new()),
            [n, 3, CORRECTIVES] if n == count => {
                // Zeros, as bodies without correctives carry them for strict readers, cost nothing here.
                let zero = array.data.iter().all(|&x| x == 0.0);
                Ok(if zero {
                    Vec::new()
                } else {
                    columns(&array, CORRECTIVES)
                })
            }
            _ => {
                let expected = format!("{count}x3x{CORRECTIVES} numbers, or none");
                Err(MeshError::unfit("posedirs", expected, shape(&array)))
            }
        }
    }

    fn faces(&mut self, count: usize) -> Result<Vec<[u32; 3]>, MeshError> {
        let array = self.need("f")?;
        if array.shape.len() != 2 || array.shape[1] != 3 {
            return Err(MeshError::unfit(
                "f",
                "triangles of 3 vertices",
                shape(&array),
            ));
        }
        if let Some(bad) = array
            .data
            .iter()
            .find(|&&v| v < 0.0 || v >= count as f64 || v.fract() != 0.0)
        {
            return Err(MeshError::unfit(
                "f",
                format!("vertices from 0 to {}", count - 1),
                bad.to_string(),
            ));
        }
        let corner = |v: &f64| *v as u32;
        Ok(array
            .data
            .chunks_exact(3)
            .map(|f| [corner(&f[0]), corner(&f[1]), corner(&f[2])])
            .collect())
    }

    /// Skinning weights, every row of which sums to one: vertices of others would move towards the origin of the pose's
    /// axes, which is the camera.
    fn weights(&mut self, count: usize) -> Result<Weights, MeshError> {
        let mut array = self.need("weights")?;
        if array.shape[..] != [count, JOINTS] {
            let expected = format!("{count}x{JOINTS} numbers");
            return Err(MeshError::unfit("weights", expected, shape(&array)));
        }
        for (vertex, row) in array.data.chunks_exact_mut(JOINTS).enumerate() {
            let sum: f64 = row.iter().sum();
            if (sum - 1.0).abs() > SUM_TOLERANCE || row.iter().any(|&w| w < -SUM_TOLERANCE) {
                let found = format!("{sum:.3} for vertex {vertex}");
                return Err(MeshError::unfit(
                    "weights",
                    "rows from 0 that sum to 1",
                    found,
                ));
            }
            row.iter_mut().for_each(|w| *w /= sum);
        }
        Ok(Weights::new(&array.data))
    }

    fn regressor(&mut self, count: usize) -> Result<Rows, MeshError> {
        if let Some(dense) = self.find("J_regressor")? {
            return dense_rows("J_regressor", &dense, JOINTS, count);
        }
        let Some(data) = self.find("J_regressor_data")? else {
            return Err(MeshError::Missing {
                name: "J_regressor".into(),
            });
        };
        let indices = self.need("J_regressor_indices")?;
        let starts = self.need("J_regressor_indptr")?;
        sparse_rows(&data.data, &indices.data, &starts.data, count).ok_or_else(|| {
            MeshError::unfit(
                "J_regressor_indptr",
                format!("a sparse matrix of {JOINTS} rows and {count} columns"),
                "parts that do not fit together",
            )
        })
    }

    fn reported(&mut self, count: usize) -> Result<Option<Rows>, MeshError> {
        let name = "J_regressor_edgecap21";
        self.find(name)?
            .map(|array| dense_rows(name, &array, REPORTED, count))
            .transpose()
    }
}

/// Edgecap's joints of a body that does not tell them: the tree's that carry them, which lie at the same places, and
/// for the head's top the highest vertex that the head carries.
fn untold(regressor: &Rows, template: &[[f32; 3]], weights: &Weights) -> Rows {
    let carriers = super::kinematics::CARRIERS;
    let mut rows: Rows = carriers.iter().map(|&j| regressor[j].clone()).collect();
    let is_head = |v: &usize| {
        let mut moved = weights.of(*v).iter();
        moved.any(|&(joint, w)| usize::from(joint) == carriers[HEAD_TOP] && w > 0.5)
    };
    let head = (0..template.len()).filter(is_head);
    let height = |v: &usize| template[*v][1];
    if let Some(crown) = head.max_by(|a, b| height(a).total_cmp(&height(b))) {
        rows[HEAD_TOP] = vec![(crown, 1.0)];
    }
    rows
}

/// Rows of a matrix of [`JOINTS`] rows, compressed by rows (SciPy's CSR) or by columns (CSC), as many `starts` as there
/// are tell which; `None` where the parts do not fit together.
fn sparse_rows(data: &[f64], indices: &[f64], starts: &[f64], count: usize) -> Option<Rows> {
    let by_columns = starts.len() == count + 1 && starts.len() != JOINTS + 1;
    let (lines, across) = match by_columns {
        true => (count, JOINTS),
        false => (JOINTS, count),
    };
    let whole = |x: &f64, most: usize| {
        (*x >= 0.0 && *x <= most as f64 && x.fract() == 0.0).then_some(*x as usize)
    };
    let starts: Vec<usize> = starts
        .iter()
        .map(|x| whole(x, data.len()))
        .collect::<Option<_>>()?;
    let indices: Vec<usize> = indices
        .iter()
        .map(|x| whole(x, across - 1))
        .collect::<Option<_>>()?;
    let fits = starts.len() == lines + 1
        && indices.len() == data.len()
        && starts.is_sorted()
        && starts[lines] == data.len();
    if !fits {
        return None;
    }
    let mut rows = vec![Vec::new(); JOINTS];
    for line in 0..lines {
        for i in starts[line]..starts[line + 1] {
            let (row, column) = match by_columns {
                true => (indices[i], line),
                false => (line, indices[i]),
            };
            rows[row].push((column, data[i]));
        }
    }
    Some(rows)
}

/// Whether a file begins as pickles of protocol 2 and later do; its reader is where it was afterwards.
fn is_pickle<R: Read + Seek>(reader: &mut R) -> bool {
    let mut start = [0; 2];
    let read = reader.read_exact(&mut start).is_ok();
    reader.rewind().is_ok() && read && start[0] == 0x80 && (2..=5).contains(&start[1])
}

/// Refuses bodies whose y does not point up or whose x does not point to their left: joints at rest, metres.
fn upright(joints: &[[f64; 3]; JOINTS]) -> Result<(), MeshError> {
    let [left_hip, right_hip, left_ankle, head] = [1, 2, 7, 15];
    for (from, to, axis, words) in [
        (left_ankle, head, 1, "y up"),
        (right_hip, left_hip, 0, "x to its left"),
    ] {
        let along: [f64; 3] = std::array::from_fn(|k| joints[to][k] - joints[from][k]);
        let most = along.iter().fold(0.0_f64, |most, d| most.max(d.abs()));
        if along[axis] < most {
            return Err(MeshError::unfit(
                "v_template",
                format!("a body at rest with {words}"),
                format!(
                    "{along:.2?} m from joint {from} to {to}; turn v_template, shapedirs and posedirs"
                ),
            ));
        }
    }
    Ok(())
}

fn dense_rows(name: &str, array: &Numbers, rows: usize, count: usize) -> Result<Rows, MeshError> {
    if array.shape[..] != [rows, count] {
        let expected = format!("{rows}x{count} numbers");
        return Err(MeshError::unfit(name, expected, shape(array)));
    }
    let sparse = |row: &[f64]| {
        row.iter()
            .copied()
            .enumerate()
            .filter(|&(_, w)| w != 0.0)
            .collect()
    };
    Ok(array.data.chunks_exact(count).map(sparse).collect())
}

fn shape(array: &Numbers) -> String {
    let sides: Vec<String> = array.shape.iter().map(ToString::to_string).collect();
    format!("an array of shape {}", sides.join("x"))
}

fn vertices(array: &Numbers) -> Vec<[f32; 3]> {
    let vertex = |v: &[f64]| std::array::from_fn(|k| v[k] as f32);
    array.data.chunks_exact(3).map(vertex).collect()
}

/// The last axis of vertices × 3 × `width` as the first.
fn columns(array: &Numbers, width: usize) -> Vec<Vec<[f32; 3]>> {
    let column = |c: usize| {
        let vertex = |v: &[f64]| std::array::from_fn(|k| v[k * width + c] as f32);
        array.data.chunks_exact(3 * width).map(vertex).collect()
    };
    (0..width).map(column).collect()
}

fn fixed<const N: usize>(points: &[[f64; 3]]) -> [[f64; 3]; N] {
    std::array::from_fn(|j| points[j])
}
