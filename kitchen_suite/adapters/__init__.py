"""Adapters of environments and recordings to other libraries; exported scenes; the live viewer."""
