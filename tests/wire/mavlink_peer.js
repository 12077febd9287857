// Speak MAVLink with node-mavlink, an implementation of its own: read frames as hexadecimal lines,
// write for each what it holds; then frames of its own making for the lines of JSON that follow.
const { common, ardupilotmega, minimal, MavLinkPacketParser, MavLinkPacketSplitter,
  MavLinkProtocolV2 } = require('node-mavlink')

const registry = { ...minimal.REGISTRY, ...common.REGISTRY, ...ardupilotmega.REGISTRY }
const given = JSON.parse(require('fs').readFileSync(0, 'utf8'))
const plain = (key, value) => typeof value === 'bigint' ? Number(value) : value
const key = given.key ? Buffer.from(given.key, 'hex') : null
const heard = []

const splitter = new MavLinkPacketSplitter()
splitter.pipe(new MavLinkPacketParser()).on('data', packet => {
  const kind = registry[packet.header.msgid]
  const data = packet.protocol.data(packet.payload, kind)
  heard.push({
    name: kind.MSG_NAME,
    sequence: packet.header.seq,
    system: packet.header.sysid,
    signed: key && packet.signature ? packet.signature.matches(key) : null,
    fields: Object.fromEntries(kind.FIELDS.map(field => [field.source, data[field.name]])),
  })
})
splitter.write(Buffer.from(given.frames, 'hex'))
splitter.end()

setTimeout(() => {
  const protocol = key
    ? new MavLinkProtocolV2(42, 1, MavLinkProtocolV2.IFLAG_SIGNED)
    : new MavLinkProtocolV2(42, 1)
  const frames = given.messages.map((message, sequence) => {
    const kind = Object.values(registry).find(kind => kind.MSG_NAME === message.name)
    const made = new kind()
    for (const field of kind.FIELDS) {
      const value = message.fields[field.source]
      if (value !== undefined) made[field.name] = field.type === 'uint64_t' ? BigInt(value) : value
    }
    const frame = protocol.serialize(made, sequence)
    return (key ? protocol.sign(frame, 1, key, Date.now() + sequence) : frame).toString('hex')
  })
  process.stdout.write(JSON.stringify({ heard, frames }, plain))
}, 200)
