"""The random forests of the peers SegMatch and NSM, grown by scikit-learn on the segments all others are trained on."""
