"""The bus interface of all nodes: the DBC, one record per frame, and the codec between records and frames."""
