//! Recursive estimators of a stiffness field
