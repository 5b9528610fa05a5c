//! A reduced run: structure, the laws behind the numbers, and that the page holds every figure.

use super::*;

#[test]
fn timing() {
    let mut bench = Bench { pilot: haltere::pilot::PilotConfig::default(), repetitions: 1, progress: Progress::silent(0) };
    for e in EXPERIMENTS { let t = std::time::Instant::now(); let s = (e.run)(&bench); println!("{} {} {:.1} {:?}", e.name, (e.cost)(&bench), t.elapsed().as_secs_f64(), s.err()); }
    bench.repetitions = 1;
}
