"""Training: pairs, augmentation, labels one step ahead, loss, LightningModule and DataModule."""
