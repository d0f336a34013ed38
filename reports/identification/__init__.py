"""How well the parameters of random specimens come out of campaigns like the paper's."""
