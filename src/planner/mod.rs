//! Planners: programs under limits, one file per planner.
