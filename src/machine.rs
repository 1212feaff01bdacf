//! Facts about this machine that decide what a figure means.

use std::fs;

use edgecap_kernels::{Algorithms, Isa};
use serde::Serialize;

/// Where a measurement was made.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Machine {
    /// Model name of the CPU.
    pub cpu: String,
    /// Cores that this process may use.
    pub cores: usize,
    /// Frequency governor; `None` where the system hides it, as virtual machines do.
    pub governor: Option<String>,
    /// Instruction set in use.
    pub isa: &'static str,
    /// Algorithms in use.
    pub algorithms: UsedAlgorithms,
    /// Instruction sets this CPU has kernels for, slowest first.
    pub available: Vec<&'static str>,
    /// Runnable processes, mean of the minute before the measurement; `None` where the system does not say.
    pub load: Option<f64>,
}

/// Algorithms of each precision, by name, unless `EDGECAP_ALGORITHM` names some that there are not.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct UsedAlgorithms {
    /// Of int8.
    pub int8: &'static str,
    /// Of f32.
    pub f32: &'static str,
}

impl UsedAlgorithms {
    /// What the engine chooses with kernels of `isa`.
    fn detect(isa: Isa) -> Self {
        let int8 = Algorithms::detect(isa).unwrap_or_else(|_| Algorithms::fastest(isa));
        Self {
            int8: int8.name(),
            f32: Algorithms::detect_f32().unwrap_or_default().name(),
        }
    }
}

impl Machine {
    /// Looks at this machine; kernels of `isa` will run.
    pub fn here(isa: Isa) -> Self {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let read = |path| fs::read_to_string(path).ok();
        Self {
            cpu: read("/proc/cpuinfo")
                .as_deref()
                .and_then(cpu_model)
                .unwrap_or_else(|| std::env::consts::ARCH.to_owned()),
            cores,
            governor: read("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")
                .map(|s| s.trim().to_owned()),
            isa: isa.name(),
            algorithms: UsedAlgorithms::detect(isa),
            available: Isa::available().map(Isa::name).collect(),
            load: read("/proc/loadavg").and_then(|s| s.split(' ').next()?.parse().ok()),
        }
    }

    /// Whether so much else was running that the figures are no certificate.
    pub fn is_disturbed(&self) -> bool {
        self.load.is_some_and(|l| l > 0.25 * self.cores as f64)
    }
}

/// The model name in the text of `/proc/cpuinfo`; x86 and most ARM kernels spell the key differently.
fn cpu_model(cpuinfo: &str) -> Option<String> {
    let value = |key: &str| {
        let fields = cpuinfo.lines().filter_map(|l| l.split_once(':'));
        let mut named = fields.filter(|(k, _)| k.trim() == key);
        named.next().map(|(_, v)| v.trim().to_owned())
    };
    let family = || {
        let (f, m) = (value("cpu family")?, value("model")?);
        Some(format!(" (family {f}, model {m})"))
    };
    value("model name")
        .map(|name| name + &family().unwrap_or_default())
        .or_else(|| value("Model"))
        .or_else(|| value("CPU part").map(|p| format!("ARM part {p}")))
        .filter(|name| !name.is_empty())
}

/// Peak resident memory of this process, bytes of 10⁶, since the last [`reset_peak_memory`].
pub(crate) fn peak_memory_mb() -> Option<f64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    let kib: f64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024.0 / 1e6)
}

/// How often the cores have been throttled for heat since the machine was started, as far as the kernel says.
pub(crate) fn throttled() -> Option<u64> {
    let cores = fs::read_dir("/sys/devices/system/cpu").ok()?;
    let count = |core: std::io::Result<fs::DirEntry>| {
        let count = core
            .ok()?
            .path()
            .join("thermal_throttle/core_throttle_count");
        fs::read_to_string(count).ok()?.trim().parse::<u64>().ok()
    };
    cores.filter_map(count).reduce(|a, b| a.saturating_add(b))
}

/// Forgets the peak so far; returns the resident memory now, or `None` where the system does not let us forget.
pub(crate) fn reset_peak_memory() -> Option<f64> {
    fs::write("/proc/self/clear_refs", "5").ok()?;
    peak_memory_mb()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn models_are_found_under_every_spelling() {
        let x86 = "processor\t: 0\ncpu family\t: 25\nmodel\t\t: 17\nmodel name\t: AMD EPYC\n";
        assert_eq!(cpu_model(x86).unwrap(), "AMD EPYC (family 25, model 17)");
        let pi = "processor\t: 0\nCPU part\t: 0xd0b\n\nModel\t\t: Raspberry Pi 5\n";
        assert_eq!(cpu_model(pi).unwrap(), "Raspberry Pi 5");
        assert_eq!(cpu_model("CPU part\t: 0xd0b\n").unwrap(), "ARM part 0xd0b");
        assert_eq!(cpu_model("nothing"), None);
    }

    /// With AMX they differ, unless the user names some.
    #[test]
    fn each_precision_has_the_algorithms_that_its_engine_takes() {
        let machine = serde_json::to_value(Machine::here(Isa::Amx)).unwrap();
        let told = |precision: &str| machine["algorithms"][precision].as_str();
        let int8 = Algorithms::detect(Isa::Amx).unwrap();
        let f32 = Algorithms::detect_f32().unwrap();
        assert_eq!(told("int8"), Some(int8.name()));
        assert_eq!(told("f32"), Some(f32.name()));
    }

    /// In a process of its own: what neighbouring tests give back meanwhile would be missing.
    #[test]
    fn peak_memory_sees_what_was_touched() {
        const ALONE: &str = "EDGECAP_TEST_ALONE";
        if std::env::var_os(ALONE).is_none() {
            let name = "machine::tests::peak_memory_sees_what_was_touched";
            let alone = std::process::Command::new(std::env::current_exe().unwrap())
                .args(["--exact", name, "--nocapture"])
                .env(ALONE, "1")
                .stderr(std::process::Stdio::inherit())
                .output()
                .unwrap();
            let said = String::from_utf8_lossy(&alone.stdout);
            // Its result is part of this test's, and counted there.
            print!("{}", said.replace("\ntest result:", "\n  test result:"));
            assert!(alone.status.success());
            assert!(said.contains(" 1 passed"), "no test is called {name}");
            return;
        }
        let Some(before) = reset_peak_memory() else {
            println!("skipped: /proc/self/clear_refs cannot be written here");
            return;
        };
        let block = vec![1u8; 64_000_000];
        std::hint::black_box(&block);
        assert!(peak_memory_mb().unwrap() > before + 50.0);
    }
}
