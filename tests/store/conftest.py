from store_helpers import writer

__all__ = ["writer"]
