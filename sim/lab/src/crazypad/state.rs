//! What was done to a vehicle of CrazyPAD, from the name of a folder.

/// Length of a whole propeller, mm.
const WHOLE_MM: f64 = 47.0;

/// What was done.
#[derive(Debug, Clone, PartialEq)]
pub enum Done {
    /// Nothing.
    Healthy,
    /// Propellers shortened: motor and how much was cut off of both blades together, mm.
    Cut(Vec<(usize, f64)>),
    /// Weights of a size, 1 to 3, at motors.
    Weight(usize, Vec<usize>),
    /// Tape on propellers.
    Tape(Vec<usize>),
    /// A weight of a size on a string at a motor.
    OnString(usize, usize),
}

impl Done {
    /// From a name; `None` where it says nothing known.
    pub fn of(name: &str) -> Option<Self> {
        let words: Vec<String> = name.to_lowercase().split('_').map(str::to_owned).collect();
        let number = |word: &str, letter: char| -> Option<usize> {
            word.strip_prefix(letter)?.parse().ok().filter(|n| (1..=9).contains(n))
        };
        let motors: Vec<usize> = words.iter().filter_map(|word| number(word, 'm')).collect();
        let weight = words.iter().find_map(|word| number(word, 'w'));
        let is = |what: &str| words.iter().any(|word| word == what);
        if is("normal") {
            return Some(Self::Healthy);
        }
        if motors.is_empty() {
            return None;
        }
        match () {
            () if is("string") => Some(Self::OnString(weight?, motors[0])),
            () if is("weight") => Some(Self::Weight(weight?, motors)),
            () if is("tape") => Some(Self::Tape(motors)),
            () if is("cut") => Some(Self::Cut(cuts(&words))),
            () => None,
        }
    }

    /// Motors that were changed, in order.
    pub fn motors(&self) -> Vec<usize> {
        let mut motors = match self {
            Self::Healthy => Vec::new(),
            Self::Cut(cuts) => cuts.iter().map(|(motor, _)| *motor).collect(),
            Self::Weight(_, motors) | Self::Tape(motors) => motors.clone(),
            Self::OnString(_, motor) => vec![*motor],
        };
        motors.sort_unstable();
        motors
    }
}

/// Motor by motor, what follows in mm: cuts, and at the end the length that is left, which counts where it is there.
fn cuts(words: &[String]) -> Vec<(usize, f64)> {
    let mut all: Vec<(usize, f64)> = Vec::new();
    for word in words {
        if let Some(motor) = word.strip_prefix('m').and_then(|n| n.parse().ok()) {
            all.push((motor, 0.0));
        }
        let Some(mm) = word.strip_suffix("mm").and_then(|text| text.parse::<f64>().ok()) else {
            continue;
        };
        if let Some((_, cut)) = all.last_mut() {
            *cut = if mm > 0.5 * WHOLE_MM { WHOLE_MM - mm } else { *cut + mm };
        }
    }
    all
}

#[test]
fn prop_names_of_folders_are_understood() {
    for (name, done) in [
        ("normal_flight", Done::Healthy),
        ("cut_propeller_M3_1.5mm_1.5mm_44mm", Done::Cut(vec![(3, 3.0)])),
        ("cut_propeller_M3_3mm", Done::Cut(vec![(3, 3.0)])),
        ("cut_M2_4.0mm_3.5mm_39.5mm_M1_3.5mm_3.5mm_40mm", Done::Cut(vec![(2, 7.5), (1, 7.0)])),
        ("cut_m2_0.5mm_46.5mm", Done::Cut(vec![(2, 0.5)])),
        ("add_weight_W3_near_M3", Done::Weight(3, vec![3])),
        ("tape_on_propeller_M1_M3", Done::Tape(vec![1, 3])),
        ("weight_on_string_W2_near_M3", Done::OnString(2, 3)),
    ] {
        assert_eq!(Done::of(name), Some(done), "{name}");
    }
    assert_eq!(Done::of("readme"), None);
}
