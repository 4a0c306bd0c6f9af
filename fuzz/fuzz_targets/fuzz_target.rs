//! libFuzzer around one target of `covis::fuzzing`, which the variable `COVIS_FUZZ_TARGET` names.
#![no_main]

use std::sync::LazyLock;

static TARGET: LazyLock<String> = LazyLock::new(covis_fuzz::named_target);

covis_fuzz::fuzz_target!(
    init: {
        LazyLock::force(&TARGET);
        covis_fuzz::tell_at_exit();
    },
    |input: &[u8]| covis_fuzz::run(&TARGET, input)
);
