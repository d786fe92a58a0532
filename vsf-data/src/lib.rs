//! Touch recordings and stiffness fields on disk
