//! Templates to problems: gather (queries answered), render, check.
