"""The bus as all nodes see it: the DBC, one record a frame, and the codec between them."""
