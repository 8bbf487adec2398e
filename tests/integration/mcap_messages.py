"""Prints the messages of an MCAP log: a JSON line with topic, schema, time and message."""
import json
import sys

from mcap.reader import make_reader

with open(sys.argv[1], "rb") as log:
    for schema, channel, message in make_reader(log).iter_messages():
        print(json.dumps({
            "topic": channel.topic,
            "schema": schema.name,
            "time": message.log_time,
            "message": json.loads(message.data),
        }))
