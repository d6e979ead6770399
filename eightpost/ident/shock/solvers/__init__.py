"""The ways from a record to parameters: jointly or one after the other, outliers, order, uncertainty."""
