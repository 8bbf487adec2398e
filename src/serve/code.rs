//! MongoDB's error codes and their names.

/// The codes that have a name.
const NAMES: [(i32, &str); 98] = [
    (1, "InternalError"),
    (2, "BadValue"),
    (4, "NoSuchKey"),
    (5, "GraphContainsCycle"),
    (6, "HostUnreachable"),
    (8, "UnknownError"),
    (9, "FailedToParse"),
    (10, "CannotMutateObject"),
    (11, "UserNotFound"),
    (12, "UnsupportedFormat"),
    (13, "Unauthorized"),
    (14, "TypeMismatch"),
    (15, "Overflow"),
    (16, "InvalidLength"),
    (17, "ProtocolError"),
    (18, "AuthenticationFailed"),
    (20, "IllegalOperation"),
    (22, "InvalidBSON"),
    (24, "LockTimeout"),
    (26, "NamespaceNotFound"),
    (27, "IndexNotFound"),
    (28, "PathNotViable"),
    (31, "RoleNotFound"),
    (33, "CannotBackfillArray"),
    (40, "ConflictingUpdateOperators"),
    (43, "CursorNotFound"),
    (45, "UserDataInconsistent"),
    (46, "LockBusy"),
    (48, "NamespaceExists"),
    (50, "MaxTimeMSExpired"),
    (52, "DollarPrefixedFieldName"),
    (53, "InvalidIdField"),
    (54, "NotSingleValueField"),
    (55, "InvalidDBRef"),
    (56, "EmptyFieldName"),
    (57, "DottedFieldName"),
    (59, "CommandNotFound"),
    (61, "ShardKeyNotFound"),
    (62, "OplogOperationUnsupported"),
    (64, "WriteConcernFailed"),
    (66, "ImmutableField"),
    (67, "CannotCreateIndex"),
    (68, "IndexAlreadyExists"),
    (70, "ShardNotFound"),
    (72, "InvalidOptions"),
    (73, "InvalidNamespace"),
    (79, "UnknownReplWriteConcern"),
    (85, "IndexOptionsConflict"),
    (86, "IndexKeySpecsConflict"),
    (89, "NetworkTimeout"),
    (91, "ShutdownInProgress"),
    (96, "OperationFailed"),
    (97, "OutdatedClient"),
    (100, "UnsatisfiableWriteConcern"),
    (104, "FilterNotSupported"),
    (112, "WriteConflict"),
    (115, "CommandNotSupported"),
    (117, "ConflictingOperationInProgress"),
    (121, "DocumentValidationFailure"),
    (123, "NotAReplicaSet"),
    (125, "CommandFailed"),
    (126, "RPCProtocolNegotiationFailed"),
    (136, "CappedPositionLost"),
    (139, "JSInterpreterFailure"),
    (146, "ExceededMemoryLimit"),
    (166, "CommandNotSupportedOnView"),
    (167, "OptionNotSupportedOnView"),
    (168, "InvalidPipelineOperator"),
    (171, "CannotIndexParallelArrays"),
    (175, "QueryPlanKilled"),
    (181, "AmbiguousIndexKeyPattern"),
    (184, "CollectionUUIDMismatch"),
    (194, "CanRepairToDowngrade"),
    (197, "InvalidIndexSpecificationOption"),
    (200, "MaxSubPipelineDepthExceeded"),
    (202, "NetworkInterfaceExceededTimeLimit"),
    (206, "NoSuchSession"),
    (211, "KeyNotFound"),
    (217, "IncompleteTransactionHistory"),
    (224, "QueryFeatureNotAllowed"),
    (225, "TransactionTooOld"),
    (237, "CursorKilled"),
    (238, "NotImplemented"),
    (239, "ClientMarkedKilled"),
    (246, "SnapshotUnavailable"),
    (251, "NoSuchTransaction"),
    (256, "TransactionCommitted"),
    (257, "TransactionTooLarge"),
    (260, "InvalidResumeToken"),
    (263, "OperationNotSupportedInTransaction"),
    (278, "UnsatisfiableCommitQuorum"),
    (280, "ChangeStreamFatalError"),
    (286, "ChangeStreamHistoryLost"),
    (290, "TransactionExceededLifetimeLimitSeconds"),
    (292, "QueryExceededMemoryLimitNoDiskUseAllowed"),
    (322, "APIVersionError"),
    (334, "MechanismUnavailable"),
    (352, "UnsupportedOpQueryCommand"),
];

/// Larger codes that have a name.
const LARGE: [(i32, &str); 10] = [
    (9001, "SocketException"),
    (10_107, "NotWritablePrimary"),
    (10_334, "BSONObjectTooLarge"),
    (11_000, "DuplicateKey"),
    (11_600, "InterruptedAtShutdown"),
    (11_601, "Interrupted"),
    (13_113, "MergeStageNoMatchingDocument"),
    (13_388, "StaleConfig"),
    (14_031, "OutOfDiskSpace"),
    (50_768, "NotARetryableWriteCommand"),
];

/// The name of a code; those without one are named by their number.
pub(super) fn name(code: i32) -> String {
    let known = NAMES.iter().chain(&LARGE).find(|(number, _)| *number == code);
    known.map_or_else(|| format!("Location{code}"), |(_, name)| (*name).to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_are_in_order_and_named() {
        assert!(NAMES.is_sorted_by(|a, b| a.0 < b.0) && LARGE.is_sorted_by(|a, b| a.0 < b.0));
        assert_eq!((name(59), name(40_415)), ("CommandNotFound".to_owned(), "Location40415".to_owned()));
    }
}
