"""SegMap's descriptor (Dube et al., RSS 2018): a 3-D convolutional encoder, the ESM paper's peer."""
