"""A recorded run as numbers, pictures and one page: what ``analyze`` and the end of the demo show."""
