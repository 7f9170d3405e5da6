"""The paper's experiment: which frames train and which test, the table, the pictures."""
