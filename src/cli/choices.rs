//! Values of flags by their names: a table has each value's name and help once, and what a command prints
//! has the same names. And numbers within bounds.

use std::str::FromStr;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};

/// The values of a flag: name, value, help.
pub(super) type Choices<T> = [(&'static str, T, &'static str)];

/// Takes one of `all` by its name.
pub(super) fn choice<T: Copy + Send + Sync + 'static>(
    all: &'static Choices<T>,
) -> impl TypedValueParser<Value = T> {
    choice_of(all.iter().copied())
}

/// As [`choice`], of a list that is made.
pub(super) fn choice_of<T: Copy + Send + Sync + 'static>(
    all: impl Iterator<Item = (&'static str, T, &'static str)>,
) -> impl TypedValueParser<Value = T> {
    let all: Vec<_> = all.collect();
    let names = all.iter().map(|&(name, _, help)| match help {
        "" => PossibleValue::new(name),
        help => PossibleValue::new(name).help(help),
    });
    PossibleValuesParser::new(names.collect::<Vec<_>>()).try_map(move |name| {
        let found = all.iter().find(|choice| choice.0 == name);
        found.map(|choice| choice.1).ok_or("not one of the possible values")
    })
}

/// Takes a number that `is_taken`; the error says what it `must` be.
pub(super) fn number<T: FromStr>(
    text: &str,
    must: &str,
    is_taken: impl Fn(&T) -> bool,
) -> Result<T, String> {
    text.parse().ok().filter(is_taken).ok_or_else(|| must.to_owned())
}

/// The name of a value.
pub(super) fn name_of<T: PartialEq>(all: &Choices<T>, value: &T) -> &'static str {
    all.iter().find(|choice| choice.1 == *value).map_or("unknown", |choice| choice.0)
}
