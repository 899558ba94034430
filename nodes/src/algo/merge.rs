//! Porter-Duff merges of premultiplied pictures.
