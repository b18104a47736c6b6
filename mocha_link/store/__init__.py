"""Messages: headers, bodies, the database in memory, its SQLite file."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "database": ("Database", "GROUPS"),
        "message": ("LENGTH_BYTES", "Message", "as_bytes", "message_of", "pack_batch"),
        "reassembly_buffer": ("Fragment", "MAX_RANGES", "Range", "ReassemblyBuffer", "is_alone"),
        "record": ("Kept", "Knowledge", "Record", "is_void"),
        "storage": ("Storage",),
        "storage_file": ("StorageError",),
        "trust": (
            "TeamConfig",
            "Verifier",
            "config_hash_of",
            "definitions_of",
            "difference",
            "impossibility",
            "sign",
        ),
        "wire": (
            "Header",
            "HeaderError",
            "MAX_BODY_BYTES",
            "MAX_BYTES",
            "PayloadError",
            "STAMPS_MS",
            "STAMP_MASK",
            "Trailer",
            "UNSAFE_MS",
            "WRAP_MS",
            "as_ms",
        ),
    },
    modules=("wire",),
)
