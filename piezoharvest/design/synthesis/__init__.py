"""Networks of coils and capacitors that bring a load close to the bound of passive linear shunts."""
