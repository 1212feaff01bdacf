//! The certificate as text for people.

use std::fmt;

use super::{Certificate, NetworkSpeed};

impl fmt::Display for Certificate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let m = &self.machine;
        let (width, height) = self.size;
        writeln!(f, "Speed certificate of edgecap {}\n", self.version)?;
        writeln!(f, "CPU       {}, {} cores", m.cpu, m.cores)?;
        let governor = m.governor.as_deref().unwrap_or("not visible here");
        writeln!(f, "governor  {governor}")?;
        writeln!(
            f,
            "kernels   {}, algorithms {} in int8, {} in f32 (this CPU has {})",
            m.isa,
            m.algorithms.int8,
            m.algorithms.f32,
            m.available.join(", ")
        )?;
        writeln!(
            f,
            "picture   {width}x{height} RGB bytes in, f32 maps out, batch 1"
        )?;
        for (i, n) in self.networks.iter().enumerate() {
            if self.networks[..i].iter().all(|e| e.network != n.network) {
                writeln!(f, "weights   {}: {}", n.network, n.weights)?;
            }
        }
        if let Some(load) = m.load.filter(|_| m.is_disturbed()) {
            writeln!(
                f,
                "\nNOT A CERTIFICATE: other programs were running (load {load:.1} before the start); repeat on an idle machine"
            )?;
        }
        writeln!(
            f,
            "\nMeasured peak of this machine, GMAC/s\n  threads     int8      f32"
        )?;
        for p in &self.peaks {
            writeln!(
                f,
                "  {:7} {:8.1} {:8.1}",
                p.threads, p.int8_gmacs, p.f32_gmacs
            )?;
        }
        if self.peaks.iter().any(|p| p.threads > m.cores) {
            writeln!(
                f,
                "more threads than the {} cores take turns: what they do is no measure of more cores",
                m.cores
            )?;
        }
        writeln!(
            f,
            "\n{:<10} {:<5} {:>7} {:>10} {:>8} {:>6} {:>7} {:>7} {:>6} {:>5} {:>8} {:>8} {:>6}",
            "network",
            "",
            "threads",
            "median ms",
            "p99 ms",
            "fps",
            "GMAC",
            "GMAC/s",
            "saved",
            "used",
            "memory",
            "cpu ms",
            "busy"
        )?;
        for n in &self.networks {
            writeln!(
                f,
                "{:<10} {:<5} {:>7} {:>10.2} {:>8.2} {:>6.1} {:>7.2} {:>7.1} {:>6} {:>5} {:>8} {:>8.2} {:>5.0}%",
                n.network,
                n.precision,
                n.threads,
                n.timing.median_ms,
                n.timing.p99_ms,
                n.fps,
                n.gmac,
                n.gmacs,
                percent(Some(n.saved)),
                percent(n.utilisation),
                n.memory_mb
                    .map_or(String::new(), |mb| format!("{mb:.0} MB")),
                n.processor_ms,
                100.0 * n.busy
            )?;
        }
        writeln!(
            f,
            "\nGMAC are the definition's. saved: what algorithms need not execute; used: what is executed per second, \
             of the peak"
        )?;
        if !self.ratios.is_empty() {
            writeln!(f, "\nResNet-50 takes longer than SelecSLS by")?;
        }
        for r in &self.ratios {
            writeln!(
                f,
                "  {:<4} {} threads  {:.2}x",
                r.precision, r.threads, r.resnet50_over_selecsls
            )?;
        }
        if !self.ratios.is_empty() {
            writeln!(f, "  the paper's  {:.1}x (XNect, CPU)", Self::PAPER_RATIO)?;
        }
        writeln!(
            f,
            "\nAfter Stage I, one thread, perfect maps, ms median (p99)\n  people   association          Stage II             both"
        )?;
        for p in &self.people {
            let (a, s) = (p.association, p.stage2);
            writeln!(
                f,
                "  {:6}   {:.3} ({:.3})        {:.3} ({:.3})        {:.3}",
                p.people,
                a.median_ms,
                a.p99_ms,
                s.median_ms,
                s.p99_ms,
                a.median_ms + s.median_ms
            )?;
        }
        if !self.left_out.is_empty() {
            let counts: Vec<String> = self.left_out.iter().map(usize::to_string).collect();
            writeln!(
                f,
                "left out: {} people, who cannot be told apart in {width}x{height}; use a larger --size",
                counts.join(" and ")
            )?;
        }
        self.networks.iter().try_for_each(|n| layers(n, f))
    }
}

fn percent(share: Option<f64>) -> String {
    share.map_or_else(String::new, |s| format!("{:.0}%", 100.0 * s))
}

fn layers(n: &NetworkSpeed, f: &mut fmt::Formatter<'_>) -> fmt::Result {
    if n.layers.is_empty() {
        return Ok(());
    }
    writeln!(f, "\n{} {}, {} threads", n.network, n.precision, n.threads)?;
    writeln!(
        f,
        "  {:<22} {:<26} {:>9} {:>8} {:>8} {:>6} {:>5}  kernel",
        "layer", "shape", "output", "ms", "GMAC/s", "saved", "used"
    )?;
    for l in &n.layers {
        writeln!(
            f,
            "  {:<22} {:<26} {:>9} {:>8.3} {:>8.1} {:>6} {:>5}  {}",
            l.name,
            l.shape,
            format!("{}x{}", l.output.1, l.output.0),
            l.ms,
            l.gmacs,
            percent(l.utilisation.map(|_| l.saved)),
            percent(l.utilisation),
            l.kernel
        )?;
    }
    let total: f64 = n.layers.iter().map(|l| l.ms).sum();
    writeln!(f, "  {:<22} {:<26} {:>9} {total:>8.3}", "sum", "", "")
}
