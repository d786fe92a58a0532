//! Known-answer worlds and conformance suites for tests
