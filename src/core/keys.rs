//! Keys of the configuration: what is said of one stands in one row beside its field. From the rows come the defaults,
//! the checks of ranges, the sample file, the pages, and the parameters of stations.

use std::ops::RangeInclusive;

use crate::checks::Problems;

/// One key.
#[derive(Debug)]
pub struct Key {
    /// Name in its section.
    pub name: &'static str,
    /// What people are told of it, line by line.
    pub text: &'static [&'static str],
    /// What it holds.
    pub kind: fn() -> Kind,
    /// What of that is allowed.
    pub range: Option<Range>,
    /// A value to show where the default is none; else empty.
    pub example: &'static str,
    /// A number of the vehicle, whatever room it flies in: a vehicle may tell it.
    pub of_vehicle: bool,
    /// Parameters that stations know it by: one, or one for each number of a list.
    pub parameters: &'static [Told],
}

/// Numbers that a key may hold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Range {
    /// Lowest.
    pub low: f64,
    /// Highest.
    pub high: f64,
    /// Unit; empty: none.
    pub unit: &'static str,
    /// Whether it is checked here, and not by a rule of the section that knows more.
    pub checked: bool,
}

impl Range {
    /// From its ends.
    pub const fn of(ends: &RangeInclusive<f64>, unit: &'static str, checked: bool) -> Self {
        Self { low: *ends.start(), high: *ends.end(), unit, checked }
    }
}

/// The one range of a row, if it has one.
pub const fn first(ranges: &[Range]) -> Option<Range> {
    match ranges {
        [range, ..] => Some(*range),
        [] => None,
    }
}

/// A parameter of stations.
#[derive(Debug)]
pub struct Told {
    /// Its place among all: new ones are added behind the last.
    pub index: usize,
    /// Name on the wire, at most 16 characters.
    pub name: &'static str,
    /// When a new value acts.
    pub when: When,
    /// What it does, where the first sentence of the key does not say it to a station; else empty.
    pub text: &'static str,
}

/// When a new value acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum When {
    /// At once, in flight too: outputs go on from where they are and fade to the new law.
    AtOnce,
    /// At once on the floor; in flight it is refused, because setpoints or limits would jump.
    OnFloor,
    /// After a restart: filters are built once, from the configuration.
    Restart,
}

/// What values a key takes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kind {
    /// Any number of the range.
    Number,
    /// Whole numbers of the range.
    Whole,
    /// One of these, as a number of a parameter, with its meaning.
    Choice(&'static [(i8, &'static str)]),
    /// Texts and lists of other things, which no parameter tells.
    Other,
}

/// A value of a key, as numbers. `low` is the lowest number of its range.
pub trait Value {
    /// What it takes.
    fn kind() -> Kind
    where
        Self: Sized;

    /// One of its numbers.
    fn number(&self, _part: usize, _low: f64) -> f64 {
        0.0
    }

    /// Takes over one of them.
    fn set(&mut self, _part: usize, _number: f64, _low: f64) {}

    /// Endings that the key gets for each number there is.
    fn endings(&self) -> &'static [&'static str] {
        &[""]
    }
}

impl Value for f64 {
    fn kind() -> Kind {
        Kind::Number
    }

    fn number(&self, _: usize, _: f64) -> f64 {
        *self
    }

    fn set(&mut self, _: usize, number: f64, _: f64) {
        *self = number;
    }
}

macro_rules! whole {
    ($($type:ty)*) => { $(
        impl Value for $type {
            fn kind() -> Kind {
                Kind::Whole
            }

            fn number(&self, _: usize, _: f64) -> f64 {
                f64::from(*self)
            }

            fn set(&mut self, _: usize, number: f64, _: f64) {
                *self = number as $type;
            }
        }
    )* };
}
whole!(u8 u32);

impl Value for bool {
    fn kind() -> Kind {
        Kind::Choice(&[(0, "off"), (1, "on")])
    }

    fn number(&self, _: usize, _: f64) -> f64 {
        f64::from(u8::from(*self))
    }

    fn set(&mut self, _: usize, number: f64, _: f64) {
        *self = number != 0.0;
    }
}

/// Of a choice that is left to the version.
pub const BY_VERSION: f64 = -1.0;

/// Left to the version where it is not set.
impl Value for Option<bool> {
    fn kind() -> Kind {
        Kind::Choice(&[(-1, "as the version has it"), (0, "off"), (1, "on")])
    }

    fn number(&self, part: usize, low: f64) -> f64 {
        self.map_or(BY_VERSION, |on| on.number(part, low))
    }

    fn set(&mut self, _: usize, number: f64, _: f64) {
        *self = (number >= 0.0).then_some(number != 0.0);
    }
}

/// What is not set is told as the whole number at or below its range.
impl Value for Option<f64> {
    fn kind() -> Kind {
        Kind::Number
    }

    fn number(&self, _: usize, low: f64) -> f64 {
        self.unwrap_or(low.floor())
    }

    fn set(&mut self, _: usize, number: f64, low: f64) {
        *self = (number > low.floor()).then_some(number);
    }

    fn endings(&self) -> &'static [&'static str] {
        if self.is_some() { &[""] } else { &[] }
    }
}

/// Along x, y and z.
impl Value for [f64; 3] {
    fn kind() -> Kind {
        Kind::Number
    }

    fn number(&self, part: usize, _: f64) -> f64 {
        self[part]
    }

    fn set(&mut self, part: usize, number: f64, _: f64) {
        self[part] = number;
    }

    fn endings(&self) -> &'static [&'static str] {
        &[".x", ".y", ".z"]
    }
}

/// Two ends of which one may be set before the other.
impl Value for Option<[f64; 2]> {
    fn kind() -> Kind {
        Kind::Number
    }

    fn number(&self, part: usize, _: f64) -> f64 {
        self.map_or(0.0, |ends| ends[part])
    }

    fn set(&mut self, part: usize, number: f64, _: f64) {
        self.get_or_insert([number - 1.0, number + 1.0])[part] = number;
    }

    fn endings(&self) -> &'static [&'static str] {
        if self.is_some() { &["[0]", "[1]"] } else { &[] }
    }
}

/// As many as were written; those behind are 0.
impl Value for Vec<f64> {
    fn kind() -> Kind {
        Kind::Number
    }

    fn number(&self, part: usize, _: f64) -> f64 {
        self.get(part).copied().unwrap_or(0.0)
    }

    fn set(&mut self, part: usize, number: f64, _: f64) {
        if let Some(entry) = self.get_mut(part) {
            *entry = number;
        }
    }
}

/// A value that is no number.
pub trait NoNumber {}

impl<T: NoNumber> NoNumber for Vec<T> {}
impl NoNumber for String {}
impl NoNumber for std::path::PathBuf {}
/// The number of an anchor with what is known of it.
impl NoNumber for [f64; 2] {}

impl<T: NoNumber> Value for T {
    fn kind() -> Kind {
        Kind::Other
    }
}

/// A key whose values have names: each with its meaning for stations, numbered from 0 in this order. What is none of
/// them becomes the last.
#[macro_export]
macro_rules! choices {
    ($type:ident: $($variant:ident $meaning:literal),+) => {
        impl $crate::keys::Value for $type {
            fn kind() -> $crate::keys::Kind {
                $crate::keys::Kind::Choice(&[$(($type::$variant as i8, $meaning)),+])
            }

            fn number(&self, _: usize, _: f64) -> f64 {
                f64::from(*self as u8)
            }

            fn set(&mut self, _: usize, number: f64, _: f64) {
                let all = [$($type::$variant),+];
                *self = all[(number as usize).min(all.len() - 1)];
            }
        }
    };
}

/// What is known of a section without an instance of it, and its values by their names.
pub trait Section {
    /// Tells every key, with the name of its section, and what is said of a section before its keys.
    fn rows(at: &str, tell: &mut dyn FnMut(&str, Row))
    where
        Self: Sized;

    /// The value of a key of it or of a section in it, by its name below this one.
    fn value(&self, key: &str) -> Option<&dyn Value>;

    /// The same, to change it.
    fn value_mut(&mut self, key: &str) -> Option<&mut dyn Value>;
}

/// What a section tells.
#[derive(Debug, Clone, Copy)]
pub enum Row {
    /// It begins, with what is said of it, and parameters for its keys in their order where they are not the same in
    /// every section of this kind.
    Begins(&'static [&'static str], &'static [Told]),
    /// One of its keys.
    Key(&'static Key),
}

/// Name of a section in another one; the outermost has none.
pub fn below(at: &str, section: &str) -> String {
    if at.is_empty() { section.to_owned() } else { format!("{at}.{section}") }
}

/// Checks the value of a row whose range is checked there.
pub fn check(at: &str, key: Option<&Key>, value: &dyn Value, problems: &mut Problems) {
    let Some((key, range)) = key.and_then(|key| Some((key, key.range?))) else { return };
    for (part, ending) in value.endings().iter().enumerate().filter(|_| range.checked) {
        let name = format_args!("{at}.{}{ending}", key.name);
        problems.range(name, value.number(part, range.low), range.low..=range.high, range.unit);
    }
}

/// A section of the configuration, one row a key:
///
/// ```text
/// /// What people are told of it.
/// name: type = default, [low..=high, "unit"], {"example"}, @vehicle, PARAMETER(index, When, "text of its own");
/// ```
///
/// All behind the default may be left out. `~[low..=high, …]` is told and not checked: the section's own rules do it.
/// `@vehicle`: a number of the vehicle, which a vehicle may tell. `sections` holds one section a row, with its default and
/// parameters where those are its own; `rules` names a method that finds what joins two values. In a `whole` struct a file has to name all keys or none.
#[macro_export]
macro_rules! keys {
    (@or) => { Default::default() };
    (@or $default:expr) => { $default };
    ($(#[$meta:meta])* pub struct $name:ident whole $($rest:tt)*) => {
        $crate::keys! { @section [deny_unknown_fields] $(#[$meta])* $name $($rest)* }
    };
    ($(#[$meta:meta])* pub struct $name:ident $($rest:tt)*) => {
        $crate::keys! { @section [deny_unknown_fields, default] $(#[$meta])* $name $($rest)* }
    };
    (@section [$($serde:ident),+] $(#[$meta:meta])* $name:ident {
        $($(#[doc = $text:literal])+ $key:ident: $type:ty = $default:expr
            $(, [$range:expr $(, $unit:literal)?])?
            $(, ~[$wide:expr $(, $wide_unit:literal)?])?
            $(, {$example:literal})?
            $(, @$vehicle:ident)?
            $(, $parameter:ident($index:literal, $when:ident $(, $own:literal)?))*;)*
    } $(sections {
        $($(#[doc = $about:literal])+ $section:ident: $inner:ty $(= $section_default:expr)?
            $(, $inner_parameter:ident($inner_index:literal, $inner_when:ident, $inner_text:literal))*;)+
    })? $(rules $rules:ident;)?) => {
        $(#[$meta])*
        #[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
        #[serde($($serde),+)]
        pub struct $name {
            $($(#[doc = $text])+ pub $key: $type,)*
            $($($(#[doc = $about])+ pub $section: $inner,)+)?
        }

        impl Default for $name {
            fn default() -> Self {
                Self {
                    $($key: $default,)*
                    $($($section: $crate::keys!(@or $($section_default)?),)+)?
                }
            }
        }

        impl $name {
            /// Its keys, without those of its sections.
            pub const KEYS: &'static [$crate::keys::Key] = &[$($crate::keys::Key {
                name: stringify!($key),
                text: &[$($text),+],
                kind: <$type as $crate::keys::Value>::kind,
                range: $crate::keys::first(&[
                    $($crate::keys::Range::of(&$range, concat!("" $(, $unit)?), true),)?
                    $($crate::keys::Range::of(&$wide, concat!("" $(, $wide_unit)?), false),)?
                ]),
                example: concat!("" $(, $example)?),
                of_vehicle: !{ const OF: &[&str] = &[$(stringify!($vehicle))?]; OF }.is_empty(),
                parameters: &[$($crate::keys::Told {
                    index: $index,
                    name: stringify!($parameter),
                    when: $crate::keys::When::$when,
                    text: concat!("" $(, $own)?),
                }),*],
            }),*];

            /// Says what is wrong with the values under `key`, the name of the section.
            pub fn check(&self, key: &str, problems: &mut $crate::checks::Problems) {
                #[allow(unused_mut, unused_variables)]
                let mut own = Self::KEYS.iter();
                $($crate::keys::check(key, own.next(), &self.$key, problems);)*
                $($(self.$section.check(&$crate::keys::below(key, stringify!($section)), problems);)+)?
                $(self.$rules(key, problems);)?
            }
        }

        impl $crate::keys::Section for $name {
            fn rows(at: &str, tell: &mut dyn FnMut(&str, $crate::keys::Row)) {
                Self::KEYS.iter().for_each(|key| tell(at, $crate::keys::Row::Key(key)));
                $($({
                    let inner = $crate::keys::below(at, stringify!($section));
                    const TOLD: &[$crate::keys::Told] = &[$($crate::keys::Told {
                        index: $inner_index,
                        name: stringify!($inner_parameter),
                        when: $crate::keys::When::$inner_when,
                        text: $inner_text,
                    }),*];
                    tell(&inner, $crate::keys::Row::Begins(&[$($about),+], TOLD));
                    <$inner as $crate::keys::Section>::rows(&inner, tell);
                })+)?
            }

            fn value(&self, key: &str) -> Option<&dyn $crate::keys::Value> {
                match key.split_once('.').unwrap_or((key, "")) {
                    $((stringify!($key), _) => Some(&self.$key),)*
                    $($((stringify!($section), inner) => self.$section.value(inner),)+)?
                    _ => None,
                }
            }

            fn value_mut(&mut self, key: &str) -> Option<&mut dyn $crate::keys::Value> {
                match key.split_once('.').unwrap_or((key, "")) {
                    $((stringify!($key), _) => Some(&mut self.$key),)*
                    $($((stringify!($section), inner) => self.$section.value_mut(inner),)+)?
                    _ => None,
                }
            }
        }
    };
}
