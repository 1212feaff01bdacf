//! Nothing. `README.md` says why.
