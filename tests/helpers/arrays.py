"""Files of arrays as no library writes them."""


def npy(header, data=b""):
    """Returns an npy file with a given header."""
    text = header.encode().ljust(118) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + data
