"""The end of an MCAP file: what it holds and where, with a checksum."""

from collections.abc import Iterable, Iterator, Sequence
from struct import Struct
from zlib import crc32

from mcap.opcode import Opcode
from mcap.records import Attachment, AttachmentIndex, Metadata, MetadataIndex, SummaryOffset

from rled_msgs_py.bags.mcap_records import HEAD, MAGIC, packed, parse

FOOTER = Struct("<QQ")
CRC = Struct("<I")


def summary(start: int, groups: Sequence[tuple[Opcode, Iterable[bytes]]]) -> Iterator[bytes]:
    """Summary, footer and magic, piece by piece, so that a long index is never in memory as a whole.

    Args:
        start: where the summary begins in the file.
        groups: its records; of one kind in each group, packed, in pieces.
    """
    at, crc, offsets = start, 0, b""
    for opcode, pieces in groups:
        begin = at
        for piece in pieces:
            yield piece
            at, crc = at + len(piece), crc32(piece, crc)
        if at > begin:
            offsets += packed(SummaryOffset(group_opcode=opcode, group_start=begin, group_length=at - begin))
    footer = HEAD.pack(Opcode.FOOTER, FOOTER.size + CRC.size) + FOOTER.pack(start, at)
    yield offsets + footer + CRC.pack(crc32(offsets + footer, crc)) + MAGIC


def index_of(opcode: int, content: bytes, start: int) -> Iterator[tuple[Opcode, bytes]]:
    """The record by which the summary finds an attachment or metadata; nothing for other records.

    Args:
        opcode: of the record.
        content: of the record.
        start: where the record begins in the file.

    Raises:
        Damage: the content is something else.
    """
    length = HEAD.size + len(content)
    if opcode == Opcode.METADATA:
        name = parse(Metadata, content, 0, len(content)).name
        yield Opcode.METADATA_INDEX, packed(MetadataIndex(start, length, name))
    if opcode == Opcode.ATTACHMENT:
        found = parse(Attachment, content, 0, len(content))
        times, size = (found.log_time, found.create_time), len(found.data)
        index = AttachmentIndex(start, length, *times, size, found.name, found.media_type)
        yield Opcode.ATTACHMENT_INDEX, packed(index)
