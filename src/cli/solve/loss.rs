//! The `--loss` argument: `trivial`, `huber:W` or `cauchy:W`.

use covis_solvers::loss::Loss;

/// Parses the argument; the error is a sentence for clap.
pub(super) fn parse(text: &str) -> Result<Loss, String> {
    let wrong = || "must be trivial, huber:W or cauchy:W with a positive W".to_owned();
    let loss = match text.split_once(':') {
        None if text == "trivial" => Loss::Trivial,
        Some(("huber", width)) => Loss::Huber(width.parse().map_err(|_error| wrong())?),
        Some(("cauchy", width)) => Loss::Cauchy(width.parse().map_err(|_error| wrong())?),
        None | Some(_) => return Err(wrong()),
    };
    if loss.is_valid() { Ok(loss) } else { Err(wrong()) }
}

#[cfg(test)]
mod tests {
    use covis_solvers::loss::Loss;

    use super::parse;

    #[test]
    fn reads_the_three_forms_and_refuses_others() {
        assert_eq!(parse("trivial"), Ok(Loss::Trivial));
        assert_eq!(parse("huber:1.5"), Ok(Loss::Huber(1.5)));
        assert_eq!(parse("cauchy:2"), Ok(Loss::Cauchy(2.0)));
        for text in ["", "huber", "huber:", "huber:-1", "cauchy:nan", "cauchy:inf", "tukey:1"] {
            assert!(parse(text).is_err(), "{text}");
        }
    }
}
