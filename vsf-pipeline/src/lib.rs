//! From a recording to a stiffness field and its prediction errors
