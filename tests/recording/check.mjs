// Checks recordings with the official MCAP reader, and holds `gnathion recording info` against it.
// Usage: node check.mjs GNATHION FILE.mcap...
import { execFileSync } from "node:child_process";
import { open, readFile } from "node:fs/promises";
import { basename } from "node:path";
import { crc32 } from "@foxglove/crc";
import { McapIndexedReader, McapStreamReader } from "@mcap/core";
import { FileHandleReadable } from "@mcap/nodejs";
import { loadDecompressHandlers, protobufFromBinaryDescriptor } from "@mcap/support";

const [gnathion, ...files] = process.argv.slice(2);
const decompressHandlers = await loadDecompressHandlers();
const MAX_CHUNK_NS = 100_000_000n;
const MAX_CHUNK_BYTES = 4n << 20n;
const KINDS = {
  "foxglove.RawImage": "frames",
  "gnathion.v1.Event": "events",
  "gnathion.v1.PoseState": "poses",
  "gnathion.v1.SurfaceScan": "scans",
  "gnathion.v1.RawTransfer": "transfers",
};
let failures = 0;

function check(file, what, good) {
  if (good) return;
  failures++;
  console.log(`FAILED: ${basename(file)}: ${what}`);
}

// Front to back: magic, every record, the CRC of each chunk and attachment, the end of data.
async function readThrough(file) {
  const reader = new McapStreamReader({ decompressHandlers, validateCrcs: true, includeChunks: true });
  const bytes = new Uint8Array(await readFile(file));
  reader.append(bytes);
  const seen = { messages: 0, chunks: [], attachments: 0, indexes: 0, withoutCrc: 0 };
  for (let record; (record = reader.nextRecord()); ) {
    if (record.type === "Message") seen.messages++;
    if (record.type === "MessageIndex") seen.indexes++;
    if (record.type === "Attachment") seen.attachments++;
    if (record.type === "Chunk") {
      seen.chunks.push(record);
      if (record.uncompressedCrc === 0) seen.withoutCrc++;
    }
  }
  check(file, "the stream reader did not come to the end", reader.done() && reader.bytesRemaining() === 0);
  check(file, "chunks without CRC", seen.withoutCrc === 0);
  for (const chunk of seen.chunks) {
    const size = chunk.uncompressedSize;
    check(file, `a chunk of ${chunk.messageEndTime - chunk.messageStartTime} ns`,
      chunk.messageEndTime - chunk.messageStartTime <= MAX_CHUNK_NS);
    check(file, `a chunk of ${size} bytes`, size <= MAX_CHUNK_BYTES + 4096n);
  }
  return seen;
}

// The summary's own CRC, which the reader does not look at: from the summary's start to the CRC itself.
async function checkSummaryCrc(file, footer) {
  const bytes = await readFile(file);
  const crcAt = bytes.length - 8 - 4;
  const summary = bytes.subarray(Number(footer.summaryStart), crcAt);
  check(file, "the summary's CRC does not match", footer.summaryCrc !== 0 && crc32(summary) === footer.summaryCrc);
}

function decode(types, schema, message) {
  if (!types.has(schema.id)) types.set(schema.id, protobufFromBinaryDescriptor(schema.data).lookupType(schema.name));
  return types.get(schema.id).decode(message.data);
}

// By the index: every message decodes by the schema that stands in the file; counts by stream.
async function readByIndex(file, handle) {
  const readable = new FileHandleReadable(handle);
  const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers });
  const streams = {}, types = new Map();
  let messages = 0, last = 0n, transforms = 0, validPoses = 0;
  const stream = (name) => (streams[name] ??= { received: 0, missing: 0, rejected: {} });
  for await (const message of reader.readMessages({ validateCrcs: true })) {
    messages++;
    check(file, "the index is not in order of time", message.logTime >= last);
    last = message.logTime;
    const channel = reader.channelsById.get(message.channelId);
    const schema = reader.schemasById.get(channel.schemaId);
    check(file, "a channel is not protobuf", channel.messageEncoding === "protobuf" && schema.encoding === "protobuf");
    const content = decode(types, schema, message);
    if (schema.name === "gnathion.v1.LedgerEntry") {
      const entry = stream(content.stream);
      if (content.fate === 2) entry.missing += content.count;
      if (content.fate === 1) entry.rejected[content.reason] = (entry.rejected[content.reason] ?? 0) + content.count;
      continue;
    }
    if (schema.name === "foxglove.FrameTransform") {
      const q = content.rotation;
      check(file, "a rotation is not of length 1", Math.abs(Math.hypot(q.x, q.y, q.z, q.w) - 1) < 1e-9);
      transforms++;
      continue;
    }
    check(file, `an unknown schema ${schema.name}`, schema.name in KINDS);
    const entry = stream(channel.metadata.get("stream"));
    entry.received++;
    entry.kind = KINDS[schema.name];
    if (schema.name === "gnathion.v1.PoseState" && content.valid) validPoses++;
    if (schema.name === "foxglove.RawImage") {
      check(file, "an image's bytes do not fit its size",
        content.data.length === content.width * content.height && content.encoding === "mono8");
      const ns = BigInt(content.timestamp.seconds.toString()) * 1_000_000_000n + BigInt(content.timestamp.nanos);
      check(file, "an image's time is not its capture time", ns === message.publishTime);
    }
  }
  check(file, "valid poses and their transforms", transforms === validPoses);
  const attachments = [];
  for await (const attachment of reader.readAttachments({ validateCrcs: true }))
    attachments.push({ name: attachment.name, bytes: attachment.data.length });
  return { reader, messages, streams, attachments };
}

function compareWithInfo(file, seen, index) {
  const info = JSON.parse(execFileSync(gnathion, ["recording", "info", "--json", "--quiet", file]));
  check(file, "gnathion finds it damaged", info.whole);
  check(file, "messages", info.messages === index.messages);
  check(file, "chunks", info.chunks === seen.chunks.length);
  const names = Object.keys(index.streams).sort();
  check(file, `streams ${names} and ${Object.keys(info.streams)}`,
    JSON.stringify(names) === JSON.stringify(Object.keys(info.streams).sort()));
  for (const name of names) {
    const official = index.streams[name], ours = info.streams[name];
    for (const key of ["received", "missing"])
      check(file, `${name}: ${key} ${official[key]} and ${ours[key]}`, official[key] === ours[key]);
    check(file, `${name}: rejected`, JSON.stringify(official.rejected) === JSON.stringify(ours.rejected));
    if (official.kind) check(file, `${name}: kind ${official.kind} and ${ours.kind}`, official.kind === ours.kind);
  }
  const byName = (a, b) => (a.name < b.name ? -1 : 1);
  check(file, "attachments",
    JSON.stringify(index.attachments.sort(byName)) ===
      JSON.stringify(info.attachments.map(({ name, bytes }) => ({ name, bytes })).sort(byName)));
}

for (const file of files) {
  const before = failures;
  const handle = await open(file, "r");
  try {
    const seen = await readThrough(file);
    const index = await readByIndex(file, handle);
    await checkSummaryCrc(file, index.reader.footer);
    const statistics = index.reader.statistics;
    check(file, "messages by stream and by index", seen.messages === index.messages);
    check(file, "messages by the statistics", BigInt(index.messages) === statistics.messageCount);
    check(file, "chunks by the statistics", seen.chunks.length === statistics.chunkCount);
    check(file, "chunks by the index", seen.chunks.length === index.reader.chunkIndexes.length);
    check(file, "attachments by the statistics", seen.attachments === statistics.attachmentCount);
    compareWithInfo(file, seen, index);
    console.log(`${failures === before ? "ok" : "FAILED"}: ${basename(file)}: ${index.messages} messages in ` +
      `${seen.chunks.length} chunks, ${index.attachments.length} attachments`);
  } catch (error) {
    failures++;
    console.log(`FAILED: ${basename(file)}: ${error.stack}`);
  } finally {
    await handle.close();
  }
}
console.log(failures === 0 ? `${files.length} recordings, all as the official reader reads them` : `${failures} failures`);
process.exit(failures === 0 ? 0 : 1);
