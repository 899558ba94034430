//! Picture files to samples and back, as bytes.
