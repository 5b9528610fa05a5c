//! Recordings of others that claim anything, through their readers and everything that is made of them.

use std::fmt::Write as _;
use std::path::Path;

use haltere::fit::source::Source;
use haltere::fit::tell;
use haltere_log::import::{Recording, columns, flapper, stand};

use super::logs::Dice;

/// Cells that go wrong most easily.
const CELLS: [&str; 16] = [
    "0", "-0", "1", "-1", "0.5", "7.4", "1e9", "1e18", "1.7e308", "-1.7e308", "5e-324", "inf",
    "NaN", "", "x", "65535",
];

/// A column's cell: mostly what a flight has, or anything.
fn cell(dice: &mut Dice, usual: f64, wild: bool) -> String {
    if wild && dice.roll(12) == 0 {
        CELLS[dice.roll(CELLS.len())].to_owned()
    } else {
        format!("{}", usual + 0.01 * dice.roll(100) as f64)
    }
}

/// A recording of our layout with every column. `step_s` apart; some stamps jump.
pub fn ours(seed: u64, rows: usize, step_s: f64, wild: bool) -> String {
    let mut dice = Dice(seed);
    let mut text = String::from(
        "# haltere-import 1\n# signs: ned-frd\nt_s,x_m,y_m,z_m,roll_deg,pitch_deg,yaw_deg,thrust_frac,\
         supply_v,acc_x_mps2,acc_y_mps2,acc_z_mps2,rate_x_radps,rate_y_radps,rate_z_radps,set_roll_deg,\
         set_pitch_deg,set_yaw_deg\n",
    );
    let mut t_s = 0.0;
    for n in 0..rows {
        t_s += step_s;
        if wild && dice.roll(200) == 0 {
            t_s += [10.0, 1e6, 1e15, 1e300][dice.roll(4)];
        }
        let lean = 8.0 * f64::from(u8::from(n / 40 % 2 == 0));
        let usual = [
            0.1, 0.2, -1.3, lean, -lean, 10.0, 0.6, 7.4, 0.1, 0.1, -9.8, 0.0, 0.0, 0.0, lean,
            -lean, 10.0,
        ];
        let _ = write!(text, "{t_s}");
        for usual in usual {
            let _ = write!(text, ",{}", cell(&mut dice, usual, wild));
        }
        text.push('\n');
    }
    text
}

/// Everything that is made of a recording.
fn judged(recording: Recording) {
    let sources = [Source::Recording(recording)];
    let _ = tell::drag::fit(&sources, false);
    let _ = tell::thrust::fit(&sources);
    let _ = tell::ground::fit(&sources, -1.0, false);
    let _ = tell::lag::fit(&sources);
    let _ = tell::imu::fit(&sources);
    let _ = tell::carry_over::fit(&sources[0], &sources);
}

/// Reads the text by every reader and goes on with what they take.
pub fn through(text: &str) {
    if let Ok(recording) = columns::parse(text.as_bytes(), Path::new("a.csv")) {
        judged(recording);
    }
    let others =
        "timeTick,roll,pitch,thrust,vbat,otX0,otY0,otZ0,otRoll0,otPitch0,otYaw0,accX,accY,accZ\n";
    let rows = text.lines().skip(3).map(|line| {
        let cells: Vec<&str> = line.split(',').collect();
        let at = |i: usize| cells.get(i).copied().unwrap_or_default();
        let places = [0, 4, 5, 7, 8, 1, 2, 3, 4, 5, 6, 9, 10, 11];
        places.map(at).join(",")
    });
    let text = others.to_owned() + &rows.collect::<Vec<_>>().join("\n");
    if let Ok(recording) = flapper::parse(text.as_bytes(), Path::new("a.csv.gz")) {
        judged(recording);
    }
    let text = text.replacen("roll,pitch,thrust", "weight[g],pwm,vbat[V]", 1);
    if let Ok(stand) = stand::parse(text.as_bytes(), Path::new("a.csv")) {
        let sources = [Source::Stand(stand)];
        let _ = tell::thrust::fit(&sources);
        let _ = tell::carry_over::fit(&sources[0], &sources);
    }
}
