//! Tests of place recognition.
