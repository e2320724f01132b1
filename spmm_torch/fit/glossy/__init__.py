"""The objective of glossy data: what eyes see, and peaks that no sample resolves."""
