//! `edgecap config`: is the file right, what holds and where it came from, a file to begin with.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_json::Value;

use super::doctor::held_back;
use super::say;
use super::settings::{self, ConfigArgs, Effective, Origins, RunArgs, Settings};
use crate::config::Origin;

/// Columns that a key and its value take before what is said of it.
const MARGIN: usize = 40;

/// Options of `edgecap config`.
#[derive(Debug, clap::Args)]
#[command(arg_required_else_help = false)]
pub struct ConfigVerb {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, clap::Subcommand)]
enum What {
    /// Say whether the file is right, else the first mistake with its line and column
    Check(ConfigArgs),
    /// Print what a run with these flags takes, and where each value came from
    Print(Box<RunArgs>),
    /// Print a commented file with every key, to begin with
    Sample,
}

/// Looks at settings.
///
/// # Errors
/// What is wrong with them; exit code 78. 74 where what is printed cannot be written.
pub fn config(args: ConfigVerb) -> anyhow::Result<()> {
    match args.what {
        What::Check(args) => {
            let settings = Settings::load(&args)?;
            // Files that it names are part of it.
            let run = RunArgs::of_settings(args);
            let effective = settings::effective(&run, &settings)?;
            effective.check()?;
            effective.expect_start()?;
            let runs = effective.runs()?;
            let file = settings.file.as_deref();
            say::whole(&checked(file, &runs, &effective.reads()))?;
        }
        What::Print(run) => {
            let settings = Settings::load(&run.settings)?;
            let effective = settings::effective(&run, &settings)?;
            effective.runs()?;
            say::whole(&printed(&effective, &settings)?)?;
        }
        What::Sample => say::whole(settings::SAMPLE)?,
    }
    Ok(())
}

/// That settings are right, and what they want of the service's unit.
fn checked(file: Option<&Path>, runs: &[RunArgs], reads: &[(&'static str, PathBuf)]) -> String {
    let mut out = match file {
        Some(file) => format!("{}: right", file.display()),
        None => "no edgecap.toml: defaults hold; 'edgecap config sample' is one".to_owned(),
    };
    for finding in held_back(file, runs, reads) {
        let _ = write!(out, "\n{finding}");
    }
    out
}

fn printed(effective: &Effective, settings: &Settings) -> anyhow::Result<String> {
    let mut out = String::new();
    match &settings.file {
        Some(file) => writeln!(
            out,
            "# What holds: flags, else {}, else defaults",
            file.display()
        )?,
        None => writeln!(
            out,
            "# What holds: flags, else defaults; there is no edgecap.toml"
        )?,
    }
    for camera in &effective.cameras {
        out += "\n[[camera]]\n";
        let (args, origins) = (&camera.args, &camera.origins);
        for section in [
            json(&args.input)?,
            json(&args.pace)?,
            json(&args.fitting)?,
            json(&args.record)?,
        ] {
            print(&mut out, &section, &mut |key| origin(origins, key));
        }
    }
    let network = &effective.network;
    table(
        &mut out,
        "network",
        &json(&effective.cameras[0].args.engine)?,
        &|key| origin(network, key),
    );
    let places = &effective.fit.places;
    table(&mut out, "fit", &json(&effective.fit.value)?, &|key| {
        places
            .get(key)
            .map_or(Origin::Default, |p| Origin::File(*p))
    });
    let (metrics, origins) = &effective.metrics;
    table(&mut out, "metrics", &json(metrics)?, &|key| {
        origin(origins, key)
    });
    let (bridges, origins) = &effective.bridges;
    table(&mut out, "bridges", &json(bridges)?, &|key| {
        origin(origins, key)
    });
    let (multiview, origins) = &effective.multiview;
    table(&mut out, "multiview", &json(multiview)?, &|key| {
        origin(origins, key)
    });
    Ok(out)
}

/// As text and back: numbers of 32 bits keep the digits that they were given with.
fn json<T: Serialize>(section: &T) -> serde_json::Result<Value> {
    serde_json::from_str(&serde_json::to_string(section)?)
}

fn origin(origins: &Origins, key: &str) -> Origin {
    origins.get(key).copied().unwrap_or(Origin::Default)
}

/// A section and the tables below it.
fn table(out: &mut String, name: &str, section: &Value, origin: &dyn Fn(&str) -> Origin) {
    let _ = writeln!(out, "\n[{name}]");
    let Value::Object(fields) = section else {
        return;
    };
    let (below, here): (serde_json::Map<_, _>, serde_json::Map<_, _>) = fields
        .clone()
        .into_iter()
        .partition(|(_, value)| value.is_object());
    print(out, &Value::Object(here), &mut |key| origin(key));
    for (key, value) in below {
        table(out, &format!("{name}.{key}"), &value, &|k| {
            origin(&format!("{key}.{k}"))
        });
    }
}

/// A line for each key.
fn print(out: &mut String, section: &Value, origin: &mut dyn FnMut(&str) -> Origin) {
    let Value::Object(fields) = section else {
        return;
    };
    for (key, value) in fields {
        let line = match toml(value) {
            Some(value) => format!("{key} = {value}"),
            None => format!("#{key} ="),
        };
        let from = match origin(key) {
            Origin::Flag => "typed".to_owned(),
            Origin::File((line, _)) => format!("line {line}"),
            Origin::Default => "default".to_owned(),
        };
        let _ = writeln!(out, "{line:MARGIN$} # {from}");
    }
}

/// A value in one line of TOML; `None` where there is none.
fn toml(value: &Value) -> Option<String> {
    /// What TOML has no word for is left out.
    fn without_nothing(value: &Value) -> Option<Value> {
        Some(match value {
            Value::Null => return None,
            Value::Object(fields) => fields
                .iter()
                .filter_map(|(k, v)| Some((k.clone(), without_nothing(v)?)))
                .collect(),
            other => other.clone(),
        })
    }
    let value = toml::Value::try_from(without_nothing(value)?).ok()?;
    Some(value.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_that_the_unit_does_not_suffice_for_are_right_and_more() {
        let mut run = RunArgs::default();
        run.record.jsonl = Some("/srv/hall.jsonl".into());
        let said = checked(Some(Path::new("/etc/edgecap/edgecap.toml")), &[run], &[]);
        let (first, rest) = said.split_once('\n').unwrap();
        assert_eq!(first, "/etc/edgecap/edgecap.toml: right");
        assert!(rest.contains("ReadWritePaths=/srv, "), "{rest}");
    }
}
