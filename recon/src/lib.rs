//! recon
