#!/usr/bin/env python3
"""Runs unified specification tests of MongoDB's drivers against a server, by hand.

    run.py URI FOLDER...

FOLDER is one of github.com/mongodb/specifications (source/crud/tests/unified, ...). What is judged is
the server: the results, errors and outcomes of operations. What the tests expect of the driver's own
events is not. Tests that need fail points of a test build, or an operation that is not known here, are
skipped, with the reason. Needs pymongo.
"""

import collections
import json
import pathlib
import sys
import time

import bson
import pymongo
from bson import json_util
from pymongo import errors, monitoring, operations, read_concern, write_concern

OPTIONS = json_util.JSONOptions(json_mode=json_util.JSONMode.CANONICAL, tz_aware=False)
TYPES = {
    "double": float, "string": str, "object": dict, "array": list, "bool": bool, "int": int, "long": int,
    "objectId": bson.ObjectId, "date": object, "null": type(None), "number": (int, float), "binData": (bytes, bson.Binary),
    "minKey": bson.MinKey, "maxKey": bson.MaxKey, "timestamp": bson.Timestamp,
}


class Skip(Exception):
    """A test that says nothing of this server."""


class Refused(Exception):
    """The server says that it does not support what the test is about."""


class Differs(Exception):
    """The server does something else than the test expects."""


def snake(name):
    return "".join("_" + c.lower() if c.isupper() else c for c in name)


def matches(expected, actual, entities, root=True):
    """Whether a result is the expected one, by the rules of the unified format."""
    if isinstance(expected, dict):
        operator = next(iter(expected), "")
        if operator == "$$exists":
            return expected[operator] is True
        if operator == "$$unsetOrMatches":
            return actual is None or matches(expected[operator], actual, entities, root)
        if operator == "$$type":
            wanted = expected[operator] if isinstance(expected[operator], list) else [expected[operator]]
            return any(isinstance(actual, TYPES.get(kind, object)) for kind in wanted)
        if operator == "$$matchesEntity":
            return entities[expected[operator]] == actual
        if operator == "$$sessionLsid":
            return True
        if operator == "$$lte":
            return actual <= expected[operator]
        if not isinstance(actual, dict):
            return False
        for key, value in expected.items():
            if isinstance(value, dict) and value.get("$$exists") is False:
                if key in actual:
                    return False
            elif isinstance(value, dict) and "$$unsetOrMatches" in value:
                if key in actual and not matches(value, actual[key], entities, False):
                    return False
            elif key not in actual or not matches(value, actual[key], entities, False):
                return False
        return root or set(actual) <= set(expected)
    if isinstance(expected, list):
        return (isinstance(actual, list) and len(expected) == len(actual)
                and all(matches(a, b, entities, root) for a, b in zip(expected, actual)))
    if isinstance(expected, (int, float)) and not isinstance(expected, bool):
        return isinstance(actual, (int, float)) and not isinstance(actual, bool) and expected == actual
    return expected == actual


def as_document(result):
    """A driver's result in the words of the tests."""
    if isinstance(result, pymongo.results.BulkWriteResult):
        if not result.acknowledged:
            return {}
        upserted = result.upserted_ids or {}
        return {
            "insertedCount": result.inserted_count, "matchedCount": result.matched_count,
            "modifiedCount": result.modified_count, "deletedCount": result.deleted_count,
            "upsertedCount": result.upserted_count, "upsertedIds": {str(k): v for k, v in upserted.items()},
        }
    if isinstance(result, pymongo.results.InsertOneResult):
        return {"insertedId": result.inserted_id} if result.acknowledged else {}
    if isinstance(result, pymongo.results.InsertManyResult):
        return {"insertedIds": {str(i): id for i, id in enumerate(result.inserted_ids)}}
    if isinstance(result, pymongo.results.UpdateResult):
        if not result.acknowledged:
            return {}
        update = {"matchedCount": result.matched_count, "modifiedCount": result.modified_count,
                  "upsertedCount": 0 if result.upserted_id is None else 1}
        if result.upserted_id is not None:
            update["upsertedId"] = result.upserted_id
        return update
    if isinstance(result, pymongo.results.DeleteResult):
        return {"deletedCount": result.deleted_count} if result.acknowledged else {}
    return result


def concern(options):
    options = dict(options or {})
    if "journal" in options:
        options["j"] = options.pop("journal")
    if "wtimeoutMS" in options:
        options["wtimeout"] = options.pop("wtimeoutMS")
    return write_concern.WriteConcern(**options)


def settings(options):
    known = {}
    for name, value in (options or {}).items():
        if name == "readConcern":
            known["read_concern"] = read_concern.ReadConcern(value.get("level"))
        elif name == "writeConcern":
            known["write_concern"] = concern(value)
        elif name == "readPreference":
            known["read_preference"] = getattr(pymongo.read_preferences, snake(value["mode"]).lstrip("_").title().replace("_", ""), None)() \
                if isinstance(value, dict) else None
        else:
            raise Skip(f"the option {name}")
    return {k: v for k, v in known.items() if v is not None}


def preference(arguments):
    """The read preference of a command, where it has one."""
    if "readPreference" not in arguments:
        return {}
    kind = arguments["readPreference"]["mode"]
    return {"read_preference": getattr(pymongo.read_preferences, kind[0].upper() + kind[1:])()}


class Test:
    def __init__(self, uri, suite, test):
        self.uri, self.suite, self.test = uri, suite, test
        self.entities = {}

    def run(self):
        self.check(self.suite.get("runOnRequirements"))
        self.check(self.test.get("runOnRequirements"))
        if self.test.get("skipReason"):
            raise Skip("the test says so")
        self.fill()
        try:
            for one in self.suite.get("createEntities", []):
                self.create(one)
            for operation in self.test["operations"]:
                self.operate(operation)
            self.outcome()
        finally:
            for entity in self.entities.values():
                if isinstance(entity, pymongo.client_session.ClientSession):
                    entity.end_session()
            for entity in self.entities.values():
                if isinstance(entity, pymongo.MongoClient):
                    entity.close()

    def check(self, requirements):
        if not requirements:
            return
        version = [6, 0, 0]
        number = lambda text: [int(part) for part in text.split(".")] + [0] * (2 - text.count("."))
        for one in requirements:
            fits = "minServerVersion" not in one or number(one["minServerVersion"]) <= version
            fits &= "maxServerVersion" not in one or number(one["maxServerVersion"].replace(".99", ".999")) >= version
            fits &= "topologies" not in one or "replicaset" in one["topologies"]
            fits &= not one.get("auth") and not one.get("csfle") and one.get("serverless") != "require"
            if fits:
                return
        raise Skip("other servers or topologies")

    def fill(self):
        admin = pymongo.MongoClient(self.uri)
        for data in self.suite.get("initialData", []):
            database = admin.get_database(data["databaseName"], write_concern=write_concern.WriteConcern("majority"))
            database.drop_collection(data["collectionName"])
            if data["documents"]:
                database[data["collectionName"]].insert_many(data["documents"])
            else:
                database.create_collection(data["collectionName"], **{snake(k) if k != "changeStreamPreAndPostImages" else k: v
                                           for k, v in data.get("createOptions", {}).items() if k != "writeConcern"})
        self.admin = admin

    def create(self, entity):
        kind, spec = next(iter(entity.items()))
        if kind == "client":
            options = dict(spec.get("uriOptions", {}))
            if spec.get("serverApi") or spec.get("autoEncryptOpts"):
                raise Skip("the option of a client")
            self.entities[spec["id"]] = pymongo.MongoClient(self.uri, **options)
        elif kind == "database":
            client = self.entities[spec["client"]]
            self.entities[spec["id"]] = client.get_database(spec["databaseName"], **settings(spec.get("databaseOptions")))
        elif kind == "collection":
            database = self.entities[spec["database"]]
            self.entities[spec["id"]] = database.get_collection(spec["collectionName"], **settings(spec.get("collectionOptions")))
        elif kind == "session":
            options = dict(spec.get("sessionOptions", {}))
            default = options.pop("defaultTransactionOptions", None)
            keywords = {snake(k): v for k, v in options.items()}
            if default is not None:
                default = settings({k: v for k, v in default.items() if k != "maxCommitTimeMS"})
                keywords["default_transaction_options"] = pymongo.client_session.TransactionOptions(**default)
            self.entities[spec["id"]] = self.entities[spec["client"]].start_session(**keywords)
        else:
            raise Skip(f"the entity {kind}")

    def operate(self, operation):
        name, arguments = operation["name"], dict(operation.get("arguments", {}))
        expected = operation.get("expectError")
        try:
            result = self.perform(operation["object"], name, arguments)
        except (errors.PyMongoError, ValueError, TypeError, bson.errors.BSONError) as error:
            if operation.get("ignoreResultAndError"):
                return
            if "is not supported by" in str(error):
                raise Refused(name) from error
            if expected is None:
                raise Differs(f"{name}: {error}") from error
            return self.compare(name, expected, error)
        if expected is not None and not operation.get("ignoreResultAndError"):
            raise Differs(f"{name}: no error, and {expected} was expected")
        if "saveResultAsEntity" in operation:
            self.entities[operation["saveResultAsEntity"]] = result
        if "expectResult" in operation and not operation.get("ignoreResultAndError"):
            if not matches(operation["expectResult"], result, self.entities):
                raise Differs(f"{name}: {result}, and {operation['expectResult']} was expected")

    def compare(self, name, expected, error):
        if expected.get("isClientError") and isinstance(error, errors.OperationFailure):
            raise Differs(f"{name}: an error of the server, and one of the client was expected")
        code = getattr(error, "code", None)
        if isinstance(error, errors.BulkWriteError):
            code = (error.details["writeErrors"] or [{"code": None}])[0]["code"]
        if "errorCode" in expected and code != expected["errorCode"]:
            raise Differs(f"{name}: code {code}, and {expected['errorCode']} was expected: {error}")
        if "errorCodeName" in expected and (error.details or {}).get("codeName") != expected["errorCodeName"]:
            raise Differs(f"{name}: {error.details}, and {expected['errorCodeName']} was expected")
        for label in expected.get("errorLabelsContain", []):
            if not error.has_error_label(label):
                raise Differs(f"{name}: no label {label}: {error}")
        for label in expected.get("errorLabelsOmit", []):
            if error.has_error_label(label):
                raise Differs(f"{name}: the label {label}")
        if "expectResult" in expected and isinstance(error, errors.BulkWriteError):
            details = error.details
            result = {"insertedCount": details["nInserted"], "matchedCount": details["nMatched"],
                      "modifiedCount": details["nModified"], "deletedCount": details["nRemoved"],
                      "upsertedCount": details["nUpserted"],
                      "upsertedIds": {str(one["index"]): one["_id"] for one in details["upserted"]}}
            if not matches(expected["expectResult"], result, self.entities):
                raise Differs(f"{name}: {result}, and {expected['expectResult']} was expected")

    def perform(self, on, name, arguments):
        if on == "testRunner":
            return self.runner(name, arguments)
        target = self.entities[on]
        if "session" in arguments:
            arguments["session"] = self.entities[arguments["session"]]
        if name == "iterateUntilDocumentOrError":
            return self.event(target)
        if name == "close":
            return target.close()
        if isinstance(target, pymongo.client_session.ClientSession):
            return self.session(target, name, arguments)
        if name == "createChangeStream":
            pipeline = arguments.pop("pipeline", None)
            return target.watch(pipeline, **{snake(k): v for k, v in arguments.items()})
        if isinstance(target, pymongo.database.Database):
            return self.database(target, name, arguments)
        if isinstance(target, pymongo.MongoClient):
            if name == "listDatabases":
                return list(target.list_databases(**arguments))
            raise Skip(f"the operation {name}")
        return self.collection(target, name, arguments)

    @staticmethod
    def event(stream):
        until = time.monotonic() + 5
        while time.monotonic() < until:
            event = stream.try_next()
            if event is not None:
                return event
        raise Differs("no event came within 5 s")

    def runner(self, name, arguments):
        if name == "createEntities":
            return [self.create(one) for one in arguments["entities"]] and None
        if name in ("assertCollectionExists", "assertCollectionNotExists"):
            found = arguments["collectionName"] in self.admin[arguments["databaseName"]].list_collection_names()
            if found != (name == "assertCollectionExists"):
                raise Differs(name)
            return None
        if name in ("assertIndexExists", "assertIndexNotExists"):
            place = self.admin[arguments["databaseName"]][arguments["collectionName"]]
            if (arguments["indexName"] in place.index_information()) != (name == "assertIndexExists"):
                raise Differs(name)
            return None
        if name in ("failPoint", "targetedFailPoint"):
            raise Skip("fail points")
        if name.startswith("assert"):
            # What is asserted of the driver's own state.
            return None
        raise Skip(f"the operation {name}")

    def session(self, session, name, arguments):
        if name == "startTransaction":
            options = {k: v for k, v in arguments.items() if k != "maxCommitTimeMS"}
            return session.start_transaction(**settings(options))
        if name in ("commitTransaction", "abortTransaction", "endSession"):
            return getattr(session, snake(name))()
        if name == "withTransaction":
            return session.with_transaction(lambda _: [self.operate(one) for one in arguments["callback"]] and None)
        raise Skip(f"the operation {name}")

    def database(self, database, name, arguments):
        if name == "runCommand":
            command = arguments.pop("command")
            return database.command(command, **preference(arguments), **{k: v for k, v in arguments.items() if k == "session"})
        if name == "aggregate":
            pipeline = arguments.pop("pipeline")
            return list(database.aggregate(pipeline, **self.keywords(arguments)))
        if name == "createCollection":
            collection = arguments.pop("collection")
            database.create_collection(collection, **arguments)
            return None
        if name == "dropCollection":
            database.drop_collection(arguments["collection"], session=arguments.get("session"))
            return None
        if name == "listCollections":
            return list(database.list_collections(**self.keywords(arguments)))
        raise Skip(f"the operation {name}")

    @staticmethod
    def keywords(arguments):
        keywords = {}
        for name, value in arguments.items():
            if name == "rawData":
                raise Skip("the option rawData")
            if name == "let" or name == "comment" or name == "batchSize":
                keywords[name if name != "batchSize" else "batchSize"] = value
            elif name == "collation":
                keywords["collation"] = pymongo.collation.Collation(**value)
            elif name == "returnDocument":
                keywords["return_document"] = value == "After"
            elif name == "sort":
                keywords["sort"] = list(value.items())
            elif name == "hint" and isinstance(value, dict):
                keywords["hint"] = list(value.items())
            elif name in ("allowDiskUse", "maxTimeMS", "maxCommitTimeMS"):
                keywords[name] = value
            else:
                keywords[snake(name)] = value
        return keywords

    def requests(self, requests):
        kinds = {"insertOne": operations.InsertOne, "updateOne": operations.UpdateOne, "updateMany": operations.UpdateMany,
                 "replaceOne": operations.ReplaceOne, "deleteOne": operations.DeleteOne, "deleteMany": operations.DeleteMany}
        for request in requests:
            name, arguments = next(iter(request.items()))
            yield kinds[name](**self.keywords(arguments))

    def collection(self, collection, name, arguments):
        keywords = self.keywords(arguments)
        if name == "aggregate" or name.startswith("findOneAnd"):
            keywords = {"bypassDocumentValidation" if k == "bypass_document_validation" else k: v for k, v in keywords.items()}
        if name in ("find", "findOne"):
            filter = keywords.pop("filter", None)
            for name_ in ("batchSize", "maxTimeMS", "allowDiskUse"):
                if name_ in keywords:
                    keywords[{"batchSize": "batch_size", "maxTimeMS": "max_time_ms", "allowDiskUse": "allow_disk_use"}[name_]] = keywords.pop(name_)
            return list(collection.find(filter, **keywords)) if name == "find" else collection.find_one(filter, **keywords)
        if name == "aggregate":
            return list(collection.aggregate(keywords.pop("pipeline"), **keywords))
        if name == "bulkWrite":
            return as_document(collection.bulk_write(list(self.requests(keywords.pop("requests"))), **keywords))
        if name == "count" and "session" in keywords:
            raise Skip("the operation count")
        if name == "count":
            return collection.count_documents(keywords.pop("filter"), **keywords)
        if name == "createIndex":
            return collection.create_index(list(arguments["keys"].items()), **{snake(k): v for k, v in arguments.items() if k != "keys"})
        if name == "dropIndex":
            return collection.drop_index(keywords.pop("name"), **keywords)
        if name == "listIndexes":
            return [dict(index) for index in collection.list_indexes(**keywords)]
        if name == "distinct":
            return collection.distinct(keywords.pop("field_name"), keywords.pop("filter", None), **keywords)
        if name == "rename":
            return collection.rename(arguments["to"], dropTarget=arguments.get("dropTarget", False)) and None
        method = getattr(collection, snake(name), None)
        if not callable(method) or isinstance(method, pymongo.collection.Collection):
            raise Skip(f"the operation {name}")
        if name == "findOneAndUpdate" or name == "findOneAndReplace" or name == "findOneAndDelete":
            keywords.setdefault("projection", None)
        return as_document(method(**keywords))

    def outcome(self):
        for one in self.test.get("outcome") or []:
            found = list(self.admin[one["databaseName"]].get_collection(
                one["collectionName"], read_concern=read_concern.ReadConcern("local")).find(sort=[("_id", 1)]))
            if found != one["documents"]:
                raise Differs(f"outcome: {found}, and {one['documents']} was expected")


def main():
    uri, counts, differing = sys.argv[1], collections.Counter(), []
    for folder in sys.argv[2:]:
        here, reasons = collections.Counter(), collections.Counter()
        for path in sorted(pathlib.Path(folder).rglob("*.json")):
            suite = json_util.loads(path.read_text(), json_options=OPTIONS)
            for test in suite.get("tests", []):
                try:
                    Test(uri, suite, test).run()
                    here["agree"] += 1
                except Skip as reason:
                    here["skipped"] += 1
                    reasons[str(reason)] += 1
                except Refused:
                    here["refused"] += 1
                except Exception as error:  # Every error is reported with its test.
                    here["differ"] += 1
                    differing.append(f"{path.name}: {test['description']}: {type(error).__name__}: {str(error)[:300]}")
        print(folder, dict(here), dict(reasons.most_common(5)))
        counts += here
    print(dict(counts))
    for line in differing:
        print(" ", line)


main()
