// What the viewers' own parsers make of a recording, topic by topic.
//
//   npm install @mcap/core @mcap/support protobufjs @foxglove/schemas esbuild
//   node tests/foxglove/viewers_parsers.mjs FILE.mcap [FOLDER OF LICHTBLICK'S SOURCE]
//
// Modules are taken from the folder that it is called in. MCAP: @mcap/core, its indexed reader, as both viewers read files.
// Protobuf: protobufjs, as both do; each well-known message must have the fields of @foxglove/schemas. With Lichtblick's
// source its own parseProtobufSchema and parseJsonSchema read every schema and every message besides.

import { createRequire } from "node:module";
import { open } from "node:fs/promises";

const require = createRequire(`${process.cwd()}/`);
const { McapIndexedReader } = require("@mcap/core");
const { loadDecompressHandlers } = require("@mcap/support");
const protobuf = require("protobufjs");
const descriptor = require("protobufjs/ext/descriptor");
const wellKnown = require("@foxglove/schemas/jsonschema");
const [file, lichtblick] = process.argv.slice(2);

async function lichtblicksParsers(folder) {
  if (!folder) return undefined;
  const from = `${folder}/packages/mcap-support/src`;
  const built = await require("esbuild").build({
    stdin: {
      contents: `export * from "${from}/parseProtobufSchema"; export * from "${from}/parseJsonSchema";`,
      resolveDir: from,
    },
    bundle: true, write: false, format: "cjs", platform: "node", nodePaths: [`${process.cwd()}/node_modules`],
  });
  const module = { exports: {} };
  new Function("module", "exports", "require", built.outputFiles[0].text)(module, module.exports, require);
  return module.exports;
}

function parserOf(schema, theirs) {
  if (schema.encoding === "protobuf") {
    const root = protobuf.Root.fromDescriptor(descriptor.FileDescriptorSet.decode(schema.data));
    const type = root.lookupType(schema.name);
    const known = wellKnown[schema.name.replace("foxglove.", "")];
    if (schema.name.startsWith("foxglove.")) {
      if (!known) throw new Error(`@foxglove/schemas has no ${schema.name}`);
      const missing = Object.keys(type.fields).map((name) => name.replace(/[A-Z]/g, (c) => (name.length > 1 ? `_${c.toLowerCase()}` : c)))
        .filter((name) => !(name in known.properties));
      if (missing.length) throw new Error(`fields that the well-known schema has not: ${missing}`);
    }
    const lichtblicks = theirs?.parseProtobufSchema(schema.name, schema.data);
    return (data) => { type.decode(data); lichtblicks?.deserialize(data); };
  }
  if (schema.encoding === "jsonschema") {
    const json = JSON.parse(new TextDecoder().decode(schema.data));
    const lichtblicks = theirs?.parseJsonSchema(json, schema.name);
    return (data) => {
      const value = JSON.parse(new TextDecoder().decode(data));
      lichtblicks?.postprocessValue(value);
      for (const name of Object.keys(json.properties)) if (!(name in value)) throw new Error(`no field ${name}`);
    };
  }
  throw new Error(`schema encoding ${schema.encoding}`);
}

const handle = await open(file);
const { size } = await handle.stat();
const readable = {
  size: async () => BigInt(size),
  read: async (offset, length) => {
    const buffer = new Uint8Array(Number(length));
    await handle.read(buffer, 0, Number(length), Number(offset));
    return buffer;
  },
};
const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers: await loadDecompressHandlers() });
const theirs = await lichtblicksParsers(lichtblick);
const rows = new Map();
const parsers = new Map();
let last = 0n, backwards = 0;
for await (const message of reader.readMessages()) {
  if (message.logTime < last) backwards += 1;
  last = message.logTime;
  const channel = reader.channelsById.get(message.channelId);
  const schema = reader.schemasById.get(channel.schemaId);
  const row = rows.get(channel.topic) ?? { messages: 0, schema: schema.name, wrong: "" };
  rows.set(channel.topic, row);
  row.messages += 1;
  if (row.wrong) continue;
  try {
    if (!parsers.has(channel.id)) parsers.set(channel.id, parserOf(schema, theirs));
    parsers.get(channel.id)(message.data);
  } catch (error) {
    row.wrong = String(error.message ?? error);
  }
}
const bad = [...rows].filter(([, row]) => row.wrong);
for (const [topic, row] of [...rows].sort()) {
  console.log(`${row.wrong ? "BAD" : "ok "} ${String(row.messages).padStart(7)}  ${topic}  ${row.schema}  ${row.wrong}`);
}
console.log(`${rows.size} topics, ${bad.length} that the viewers' parsers refuse; ${backwards} messages back in time; ` +
  `parsers: @mcap/core, protobufjs${theirs ? ", Lichtblick's own" : ""}`);
process.exit(bad.length ? 1 : 0);
