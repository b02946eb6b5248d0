// What another implementation of MCAP finds in a file, as JSON on standard output:
//     node read.mjs FILE.mcap
import { readFile } from "node:fs/promises";

import { McapIndexedReader } from "@mcap/core";
import { loadDecompressHandlers, protobufFromBinaryDescriptor } from "@mcap/support";

const bytes = await readFile(process.argv[2]);
const readable = {
  size: async () => BigInt(bytes.length),
  read: async (offset, length) => bytes.subarray(Number(offset), Number(offset + length)),
};
const decompressHandlers = await loadDecompressHandlers();
const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers });

const types = new Map();
for (const schema of reader.schemasById.values()) {
  types.set(schema.id, protobufFromBinaryDescriptor(schema.data).lookupType(schema.name));
}
const topics = {};
for await (const message of reader.readMessages({ validateCrcs: true })) {
  const { topic, schemaId } = reader.channelsById.get(message.channelId);
  const found = (topics[topic] ??= { messages: 0, first_ns: message.logTime, type: null });
  found.type = reader.schemasById.get(schemaId).name;
  found.messages += 1;
  found.last_ns = message.logTime;
  found.last = types.get(schemaId).decode(message.data);
}
const statistics = Number(reader.statistics.messageCount);
const plain = (_key, value) => (typeof value === "bigint" ? Number(value) : value);
console.log(JSON.stringify({ statistics, topics }, plain));
